// A new test: where it begins, what it reproduces, every setting, and the file that the command line runs, too.
"use strict";
import { attempt, described, get, html, isOperator, mayMove, post, say, send, state, useEffect, useRef, useState } from "/web/lab.js";
import { Form } from "/web/form.js";
import { Legend, Plot, Table, curve, figure } from "/web/parts.js";

const draft = { document: null, file: null };

export function NewTestScreen() {
  const [known, setKnown] = useState(null);
  const [schema, setSchema] = useState(null);
  const [document, setDocument] = useState(draft.document);
  const [checked, setChecked] = useState(null);
  const [wrong, setWrong] = useState("");
  const [busy, setBusy] = useState(false);
  const change = (next) => { draft.document = next; setDocument(next); setChecked(null); setWrong(""); };
  const reread = () => attempt(async () => setKnown(await get("/api/campaign_files")));
  useEffect(() => { reread(); attempt(async () => setSchema(await get("/api/campaign_schema"))); }, []);
  const begin = async (chosen) => {
    if (chosen === "") return;
    const [kind, name] = chosen.split(":");
    const found = await attempt(() => get(kind === "rig" ? `/api/rigs/${name}/template` : `/api/campaign_files/${kind}/${name}`));
    if (found) change(found.document);
  };
  const check = async (save, replace) => {
    try {
      const answer = await post("/api/campaign_files", { document, save, replace });
      setChecked(answer);
      setWrong("");
      if (save) { say(`The campaign file ${document.name} is saved; begin it on the screen Run.`); reread(); }
    } catch (error) { setChecked(null); setWrong(error.message); }
  };
  const takeLevels = async () => {
    setBusy(true);
    const found = await attempt(() => post("/api/pre_test_levels", { document }));
    setBusy(false);
    if (!found) return;
    change({ ...document, excitation: found.excitation, estimator: found.estimator });
    say(`The levels of the identification follow from the pulses of ${found.pre_test}.`);
  };
  if (!isOperator()) return html`<h1>New test</h1><p>A viewer sets up no test; ask an operator.</p>`;
  if (!known || !schema) return html`<h1>New test</h1><p role="status">Reading the campaigns …</p>`;
  const without = (key) => (known.unavailable[key] ? " (its target file is missing)" : "");
  const taken = document && known.files.includes(document.name);
  return html`<h1>New test</h1>
    <section class="card" aria-label="Beginning"><h2>1. Begin with</h2><div class="row"><label>Campaign <select name="beginning" value="" onChange=${(event) => begin(event.target.value)}>
      <option value="">choose …</option>
      <optgroup label="For a rig of this lab">${state.lab.rigs.map((rig) => html`<option value=${`rig:${rig.name}`}>${rig.name}</option>`)}</optgroup>
      ${known.files.length > 0 && html`<optgroup label="Files of this page">${known.files.map((one) => html`<option value=${`file:${one}`}>${one}${without(`file:${one}`)}</option>`)}</optgroup>`}
      <optgroup label="Shipped">${known.shipped.map((one) => html`<option value=${`shipped:${one}`}>${one}${without(`shipped:${one}`)}</option>`)}</optgroup></select></label>
      ${document && html`<p>Rig ${document.rig}.</p>`}</div></section>
    ${document && html`
      <${MeasuredTarget} document=${document} change=${change} />
      <section class="card" aria-label="Settings"><h2>3. Settings</h2><p>What is left out has its default. A unit stands in each key's help.</p>
        ${document.target?.file && html`<div class="row"><button type="button" id="levels" disabled=${busy} onClick=${takeLevels}>Levels from the pre-test</button>
          <p>The newest passed pre-test of ${document.rig} shows how far each drive moves each response: half of the target is enough for the identification.</p></div>`}
        <${Form} schema=${schema} part=${schema} value=${document} change=${change} /></section>
      <section class="card" aria-label="Check and save"><h2>4. Check and save</h2>
        <div class="row"><button type="button" id="check" onClick=${() => check(false, false)}>Check</button>
          <button type="button" id="save" disabled=${!mayMove()} onClick=${() => check(true, taken)}>${taken ? `Replace ${document.name}` : `Save as ${document.name || "…"}`}</button>
          <a href="#run">Begin it on the screen Run</a></div>
        <p role="alert" class="wrong">${wrong}</p>
        ${checked && html`<p role="status">It is a campaign file that <code>duralab run</code> takes as well.${checked.rig_is_here ? "" : ` The rig ${document.rig} is not in this lab now; its channels could not be checked.`}</p>
          ${checked.remarks.map((remark) => html`<p class="notice">${remark}</p>`)}<details><summary>The file</summary><pre tabindex="0">${checked.text}</pre></details>`}</section>`}`;
}

function leastKept(kept) {
  const [name, least] = Object.entries(kept).sort(([, one], [, other]) => one - other)[0] || [];
  return name ? `${figure(least)} (${name})` : "–";
}

function MeasuredTarget({ document, change }) {
  const [file, setFile] = useState(draft.file);
  const [busy, setBusy] = useState("");
  const [preview, setPreview] = useState(null);
  const [over, setOver] = useState(false);
  const input = useRef(null);
  const about = described(document.rig);
  const target = document.target || {};
  const put = (next) => { setPreview(null); change({ ...document, target: next }); };
  const take = async (given) => {
    if (!given) return;
    setBusy(`Reading ${given.name} …`);
    const found = await attempt(() => send(`/api/uploads/${encodeURIComponent(given.name)}`, given));
    setBusy("");
    if (!found) return;
    draft.file = found;
    setFile(found);
    const rate = about && Math.abs(found.sample_rate - about.sample_rate) > 1e-6 * about.sample_rate;
    put({ file: found.file, channels: {}, ...(rate ? { edit: [{ resample: { rate: about.sample_rate } }] } : {}) });
  };
  const map = (response, key, value) => {
    const before = target.channels?.[response] || {};
    const one = typeof before === "string" ? { from: before } : { ...before };
    if (value === "" || value === undefined) delete one[key]; else one[key] = value;
    const channels = { ...target.channels };
    if (one.from) channels[response] = one; else delete channels[response];
    put({ ...target, channels });
  };
  const names = file ? file.channels.map((one) => one.name) : [];
  const chosen = (response) => { const one = target.channels?.[response]; return typeof one === "string" ? { from: one } : one || (names.includes(response) ? { from: response } : {}); };
  const show = async () => { setBusy("Making the target …"); setPreview(await attempt(() => post("/api/target_preview", { document }))); setBusy(""); };
  return html`<section class="card" aria-label="Target"><h2>2. Target</h2>
    <p>${target.file ? `It follows the measured file ${target.file}.` : target.road || target.opencrg ? "It comes from a road that a simulated vehicle drives over. Put a measured file here to follow that." : "Put a measured file here."}</p>
    <div class=${`drop ${over ? "over" : ""}`} onDragOver=${(event) => { event.preventDefault(); setOver(true); }} onDragLeave=${() => setOver(false)}
      onDrop=${(event) => { event.preventDefault(); setOver(false); take(event.dataTransfer.files[0]); }}>
      <label>Measured file (RPC III, MDF4, UFF58, TDMS, MAT, Parquet, CSV) <input ref=${input} type="file" name="measured" onChange=${(event) => take(event.target.files[0])} /></label> or drop it here. <span role="status">${busy}</span></div>
    ${file && html`<p>${file.channels.length} channels, ${figure(file.seconds, 4)} s at ${figure(file.sample_rate, 5)} Hz.</p>
      <details open><summary>The file as it is</summary><div class="plots">${file.channels.map((channel, row) => html`<${Plot} title=${channel.name} unit=${channel.unit || "no unit"} changes=${file.file}
        curves=${[{ name: channel.name, colour: "--target", data: curve(file.low[row], file.high[row], file.bucket_seconds) }]} />`)}</div></details>`}
    ${file && about && target.file === file.file && html`
      <${Table} caption="Which channel of the file each response follows" heads=${["response", "unit of the rig", "channel of the file", "unit of the file, where it names a wrong one", "factor"]}
        rows=${about.responses.map((one) => { const is = chosen(one.name); return [one.name, one.unit,
          html`<select aria-label=${`channel for ${one.name}`} name=${`map-${one.name}`} value=${is.from || ""} onChange=${(event) => map(one.name, "from", event.target.value)}><option value="">choose …</option>${names.map((name) => html`<option value=${name}>${name}</option>`)}</select>`,
          html`<input aria-label=${`unit for ${one.name}`} size="6" value=${is.unit || ""} onInput=${(event) => map(one.name, "unit", event.target.value)} />`,
          html`<input aria-label=${`factor for ${one.name}`} size="6" inputmode="decimal" value=${is.scale ?? ""} placeholder="1" onChange=${(event) => map(one.name, "scale", event.target.value === "" ? "" : Number(event.target.value))} />`]; })} />`}
    ${target.file && html`<label class="wide">Steps of editing, as in a file, e.g. [{"filter": {"low_pass": 40}}, {"shorten_by_damage": {"keep": 0.95}}]
        <textarea name="edit" class="wide" rows="2" value=${target.edit ? JSON.stringify(target.edit) : ""} onChange=${(event) => { try { put({ ...target, edit: event.target.value.trim() ? JSON.parse(event.target.value) : undefined }); } catch { say("The steps of editing are no list; give them as in the example.", true); } }} ></textarea></label>
      <div class="row"><button type="button" id="preview" disabled=${busy !== ""} onClick=${show}>Show before and after</button></div>`}
    ${preview && html`<${Legend} curves=${[["before", "target"], ["after", "response"]]} />
      <div class="plots">${preview.after.channels.map((channel, row) => html`<${Plot} key=${channel.name} title=${`${channel.name}, before and after`} unit=${channel.unit} changes=${preview}
        curves=${[{ name: "before", colour: "--target", width: 2, data: curve(preview.before.low[row], preview.before.high[row], preview.before.bucket_seconds) },
          { name: "after", colour: "--response", data: curve(preview.after.low[row], preview.after.high[row], preview.after.bucket_seconds) }]} />`)}</div>
      <${Table} caption="What the steps did" heads=${["step", "least damage kept", "finding"]}
        rows=${preview.steps.map((step) => [step.name, leastKept(step.damage_kept), html`<div class="wrapped">${step.finding.split("; ").map((one) => html`<div>${one}</div>`)}</div>`])} />`}
  </section>`;
}
