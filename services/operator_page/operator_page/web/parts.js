// Parts that several screens use: a motion in two acts, a state with its age, tables of figures, plots.
"use strict";
import { act, answered, arm, attempt, html, mayMove, useEffect, useRef, useState } from "/web/lab.js";

export function figure(value, digits = 3) {
  if (value === null || value === undefined) return "–";
  const short = Number(value.toPrecision(digits));
  return Math.abs(short) >= 1e6 ? short.toExponential() : short.toString();
}

export const sentence = (words) => `${words.slice(0, 1).toUpperCase()}${words.slice(1)}`;
export const share = (value) => (value === null || value === undefined ? "–" : `${(100 * value).toFixed(0)} %`);
export const percent = (value) => (value === null || value === undefined ? "–" : `${(100 * value).toFixed(1)} %`);
export const clock = (when) => new Date(1000 * when).toLocaleTimeString([], { hour12: false });

// Year, month, day, as on the command line: no country reads it as another day.
export function dated(when) {
  const date = new Date(1000 * when);
  const digits = (value) => String(value).padStart(2, "0");
  return `${date.getFullYear()}-${digits(date.getMonth() + 1)}-${digits(date.getDate())} ${clock(when)}`;
}

// A test runs for weeks: the date of what was not today.
export const moment = (when) => (new Date(1000 * when).toDateString() === new Date().toDateString() ? clock(when) : dated(when));

export function span(value) {
  if (value === null || value === undefined) return "–";
  if (value < 90) return `${value.toFixed(0)} s`;
  return value < 5400 ? `${(value / 60).toFixed(0)} min` : `${(value / 3600).toFixed(1)} h`;
}

// Colour is never the only sign: each state has a word and a shape of its own.
const SHAPES = { idle: "○", playing: "▶", settling: "◐", "ramping down": "▼", waiting: "…", interlocked: "■", unknown: "?" };

export function Mode({ rig }) {
  const old = rig.age > 3;
  const mode = old ? "unknown" : rig.mode;
  return html`<span class="mode mode-${mode.replace(" ", "-")}"><span aria-hidden="true">${SHAPES[mode] || "?"}</span> ${old ? `no answer for ${span(rig.age)}` : mode}</span>`;
}

// First act: arm. Second act, within 10 s: do it.
export function Deliberate({ label, action, values, ready = true, done, kind = "" }) {
  const [armed, setArmed] = useState(null);
  const [left, setLeft] = useState(0);
  const key = JSON.stringify([action, values]);
  const go = useRef(null);
  useEffect(() => setArmed(null), [key]);
  useEffect(() => {
    if (!armed) return undefined;
    if (go.current) go.current.focus();
    const timer = setInterval(() => {
      const rest = Math.ceil((armed.until - Date.now()) / 1000);
      setLeft(rest);
      if (rest <= 0 || !mayMove()) setArmed(null);
    }, 200);
    return () => clearInterval(timer);
  }, [armed]);
  const first = async () => {
    const answer = await attempt(() => arm(action, values));
    if (answer) { setLeft(10); setArmed({ word: answer.word, until: Date.now() + 10000 }); }
  };
  const second = async () => {
    const { word } = armed;
    setArmed(null);
    const answer = await attempt(() => act(action, values, word));
    if (answer) { answered(label, answer); if (done) done(answer); }
  };
  return html`<span class="deliberate" role="group" aria-label=${label}>
    <button type="button" class="arm" disabled=${!ready || !mayMove() || armed} onClick=${first}>${armed ? "Armed" : `Arm: ${label}`}</button>
    ${armed && html`<button type="button" ref=${go} class="go ${kind}" disabled=${!mayMove()} onClick=${second}>${label} now (${left} s)</button>
    <button type="button" onClick=${() => setArmed(null)}>Disarm</button>`}
  </span>`;
}

// A number that a person typed: its value, or in `wrong` what was typed and what to write. Empty has no value.
export function typedNumber(text, { least = 0, most = Number.MAX_VALUE, whole = false, required = false } = {}) {
  const given = text.trim(), value = Number(given);
  if (given === "" && !required) return { wrong: "" };
  if ((whole ? /^\d+$/ : /^(\d+\.?\d*|\.\d+)$/).test(given) && value >= least && value <= most) return { value, wrong: "" };
  const range = most === Number.MAX_VALUE ? `of at least ${least}` : `from ${least} to ${most}`;
  return { wrong: `This is "${given}"; write a ${whole ? `whole number ${range}` : `number ${range}, with a point for the decimals`}.` };
}

export function NumberInput({ label, name, text, change, typed }) {
  return html`<label>${label} <input name=${name} inputmode="decimal" value=${text} aria-invalid=${typed.wrong ? "true" : undefined} onInput=${(event) => change(event.target.value)} />
    <small class="wrong" role="alert">${typed.wrong}</small></label>`;
}

export function Table({ caption, heads, rows, className = "" }) {
  return html`<div class="scroll" tabindex="0" role="region" aria-label=${caption}><table class=${className}>
    <caption>${caption}</caption>
    <thead><tr>${heads.map((head) => html`<th scope="col">${head}</th>`)}</tr></thead>
    <tbody>${rows.map((row) => html`<tr class=${row.className || ""}>${(row.cells || row).map((cell, i) => (i === 0
      ? html`<th scope="row">${cell}</th>` : html`<td>${cell}</td>`))}</tr>`)}</tbody></table></div>`;
}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Two points a bucket, smallest and largest value: the curve has every peak.
export function curve(low, high, step) {
  const x = [], y = [];
  for (let i = 0; i < low.length; i += 1) {
    x.push(i * step, (i + 0.5) * step);
    y.push(low[i], high[i]);
  }
  return [x, y];
}

// Number at an axis, with all the digits of its step: uPlot itself rounds to three decimals.
function mark(value, step) {
  if (value === null) return "";
  const short = Math.abs(value) < 1e-6 * step ? 0 : Number(value.toPrecision(8));
  return short !== 0 && (Math.abs(short) >= 1e6 || Math.abs(short) < 1e-3) ? short.toExponential().replace("e+", "e") : short.toString();
}

export function Plot({ title, unit, curves, changes, lines = 8, xLabel = "s" }) {
  const place = useRef(null);
  const plot = useRef(null);
  // Of the look now: a plot is drawn again where the page becomes light or dark.
  const text = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const look = `${colour("--text")} ${text}`;
  useEffect(() => {
    const names = curves.map((one) => one.name);
    place.current.dataset.ink = colour("--text");
    const height = Math.round(lines * text);
    const axis = { stroke: colour("--text"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line"), size: 5 }, values: (_, marks, axisNumber, space, step) => marks.map((value) => mark(value, step)), font: `${Math.round(0.85 * text)}px system-ui` };
    const made = new self.uPlot({
      width: place.current.clientWidth || 300, height, legend: { show: false }, cursor: { show: false }, pxAlign: false,
      scales: { x: { time: false } },
      axes: [{ ...axis, size: 1.6 * text, incrs: xLabel === "s" ? undefined : [1, 2, 5].flatMap((one) => [0, 1, 2, 3, 4, 5, 6].map((power) => one * 10 ** power)).sort((a, b) => a - b) }, { ...axis, size: 4 * text, space: 1.4 * text }],
      series: [{}, ...curves.map((one, i) => ({ label: names[i], stroke: one.marks ? "transparent" : colour(one.colour), width: one.width || 1, dash: one.dash, spanGaps: true,
        points: one.marks ? { show: true, size: 9, width: 2, stroke: colour(one.colour) } : one.points ? { show: true, size: 4, stroke: colour(one.colour), fill: colour(one.colour) } : { show: false } }))],
    }, [[], ...curves.map(() => [])], place.current);
    plot.current = made;
    const fit = new ResizeObserver(() => made.setSize({ width: place.current ? place.current.clientWidth || 300 : 300, height }));
    fit.observe(place.current);
    return () => { fit.disconnect(); made.destroy(); plot.current = null; };
  }, [title, look, curves.map((one) => one.name).join()]);
  useEffect(() => {
    if (!plot.current) return;
    const joined = curves.length > 1 ? self.uPlot.join(curves.map((one) => one.data)) : curves[0].data;
    plot.current.setData(joined);
  }, [changes, title, look]);
  const words = `${title}: ${curves.map((one) => one.name).join(", ")}`;
  return html`<figure class="plot"><figcaption>${title} <span class="unit">[${unit} over ${xLabel}]</span></figcaption>
    <div ref=${place} role="img" aria-label=${words}></div></figure>`;
}

export function Legend({ curves }) {
  return html`<p class="legend">${curves.map(([name, kind]) => html`<span><span class="key key-${kind}" aria-hidden="true"></span>${name}</span>`)}</p>`;
}
