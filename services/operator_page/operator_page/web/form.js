// A form made from the schema of the campaign file: every key with its range, its default and its help.
"use strict";
import { html, useEffect, useState } from "/web/lab.js";

const resolve = (part, schema) => (part.$ref ? { ...schema.$defs[part.$ref.split("/").pop()], ...part, $ref: undefined } : part);

function kinds(part, schema) {
  const found = resolve(part, schema);
  const all = (found.anyOf || [found]).map((one) => resolve(one, schema));
  return { ...found, options: all.filter((one) => one.type !== "null"), nullable: all.some((one) => one.type === "null") };
}

function range(one) {
  const parts = [];
  if (one.minimum !== undefined) parts.push(`at least ${one.minimum}`);
  if (one.exclusiveMinimum !== undefined) parts.push(`above ${one.exclusiveMinimum}`);
  if (one.maximum !== undefined && one.maximum < 1e15) parts.push(`at most ${one.maximum}`);
  if (one.exclusiveMaximum !== undefined && one.exclusiveMaximum < 1e15) parts.push(`below ${one.exclusiveMaximum}`);
  return parts.join(", ");
}

const shown = (value) => (value === undefined ? "" : typeof value === "string" ? value : JSON.stringify(value));

function help(known, extra) {
  const bounds = known.options.map(range).filter(Boolean).join(" or ");
  const usual = known.default === undefined || (known.description || "").includes("left out") ? "" : `left out: ${known.default === null ? "none" : shown(known.default)}`;
  return [known.description, bounds && `Range: ${bounds}.`, usual && `(${usual})`, extra].filter(Boolean).join(" ");
}

// One key. What is left empty is left out of the file, and has its default.
function Field({ name, part, schema, value, change, path }) {
  const known = kinds(part, schema);
  const single = known.options.length === 1 ? known.options[0] : null;
  const [text, setText] = useState(shown(value));
  const [wrong, setWrong] = useState("");
  useEffect(() => setText(shown(value)), [shown(value)]);
  const id = `field-${path.join("-")}`;
  const words = html`<small id=${`${id}-help`}>${help(known)}</small>`;
  const choices = single && (single.enum || (single.type === "boolean" && [true, false]));
  if (choices) {
    return html`<div class="field"><label for=${id}>${name}</label><select id=${id} aria-describedby=${`${id}-help`} value=${shown(value)}
      onChange=${(event) => change(event.target.value === "" ? undefined : choices.find((one) => shown(one) === event.target.value))}>
      <option value="">left out</option>${choices.map((one) => html`<option value=${shown(one)}>${shown(one)}</option>`)}</select>${words}</div>`;
  }
  const isText = single && single.type === "string";
  const commit = (given) => {
    setText(given);
    setWrong("");
    if (given.trim() === "") { change(undefined); return; }
    if (isText) { change(given); return; }
    try { change(JSON.parse(given)); } catch {
      if (known.options.some((one) => one.type === "string")) change(given);
      else setWrong(single && /number|integer/.test(single.type) ? "Give a number, with a point for the decimals." : "Give it as in a file: a number, [1, 2] or {\"a\": 1}.");
    }
  };
  return html`<div class="field"><label for=${id}>${name}</label><input id=${id} aria-describedby=${`${id}-help`} aria-invalid=${wrong ? "true" : undefined} value=${text} onInput=${(event) => commit(event.target.value)} />
    ${words}${wrong && html`<small class="wrong" role="alert">${wrong}</small>`}</div>`;
}

const isObject = (part, schema) => {
  const { options } = kinds(part, schema);
  return options.length === 1 && options[0].properties ? options[0] : null;
};

export function Form({ schema, part, value, change, path = [], skip = [] }) {
  const { properties } = resolve(part, schema);
  const set = (key) => (given) => {
    const next = { ...value };
    if (given === undefined) delete next[key]; else next[key] = given;
    change(next);
  };
  const entries = Object.entries(properties).filter(([key]) => !skip.includes(key));
  const plain = entries.filter(([, one]) => !isObject(one, schema));
  const nested = entries.filter(([, one]) => isObject(one, schema));
  return html`<div class="fields">${plain.map(([key, one]) => html`<${Field} key=${key} name=${key} part=${one} schema=${schema} value=${value?.[key]} change=${set(key)} path=${[...path, key]} />`)}</div>
    ${nested.map(([key, one]) => html`<details key=${key} class="section"><summary>${key} <small>${kinds(one, schema).description || ""}</small></summary>
      ${value?.[key] === undefined || value?.[key] === null
        ? html`<p>Left out. <button type="button" onClick=${() => set(key)({})}>Fill in ${key}</button></p>`
        : html`<${Form} schema=${schema} part=${isObject(one, schema)} value=${value[key]} change=${set(key)} path=${[...path, key]} />
          ${(part.required || []).includes(key) ? "" : html`<button type="button" onClick=${() => set(key)(undefined)}>Leave ${key} out</button>`}`}</details>`)}`;
}
