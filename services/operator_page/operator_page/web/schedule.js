// An endurance test begun: from a schedule file, or from drives of recordings; with a forecast before anything moves.
"use strict";
import { attempt, chooseRig, get, html, isOperator, mayMove, post, say, state, useEffect, useRef, useState } from "/web/lab.js";
import { Deliberate, Table, figure, span, typedNumber } from "/web/parts.js";

export function BeginEndurance({ broken }) {
  const [known, setKnown] = useState(null);
  const [picked, setPicked] = useState("");
  const [pace, setPace] = useState("fast");
  const [forecast, setForecast] = useState(null);
  const [busy, setBusy] = useState("");
  const asked = useRef(0);
  const read = () => attempt(async () => setKnown(await get("/api/schedules")));
  useEffect(() => { read(); }, []);
  if (!state.rig) return html`<p class="notice">There is no rig in this lab.</p>`;
  if (!isOperator()) return html`<p>No endurance test runs on this rig.</p>`;
  if (!known) return html`<p>Reading the schedules …</p>`;
  // A schedule that cannot be read has no rig; its forecast says why.
  const offered = known.schedules.filter((one) => !known.rigs[one] || known.rigs[one] === state.rig);
  const name = offered.includes(picked) ? picked : "";
  const shown = forecast && forecast.of === name ? forecast : null;
  const choose = async (chosen) => {
    // The answer of an earlier choice may come later.
    const number = ++asked.current;
    setPicked(chosen);
    setForecast(null);
    setBusy(chosen ? "Reading its drives …" : "");
    if (!chosen) return;
    const found = await attempt(() => get(`/api/schedules/${chosen}`));
    if (number !== asked.current) return;
    setForecast(found ? { ...found, of: chosen } : null);
    setBusy("");
  };
  return html`<section class="card" aria-label="Begin an endurance test"><h2>Begin an endurance test</h2>
    <div class="row"><label>Schedule <select name="schedule" value=${name} onChange=${(event) => choose(event.target.value)}><option value="">choose …</option>${offered.map((one) => html`<option value=${one}>${one}</option>`)}</select></label>
      <label>Pace of a simulated rig <select name="pace" value=${pace} onChange=${(event) => setPace(event.target.value)}><option value="fast">as fast as it can</option><option value="real">real time</option></select></label>
      <${Deliberate} label=${shown ? `Begin ${name} on ${shown.rig}` : "Begin the test"} action="/api/endurance" values=${{ name, real_time: pace === "real", ...(shown && { rigs: [shown.rig] }) }} ready=${shown !== null} done=${(answer) => chooseRig(answer.rig)} /> <span role="status">${busy}</span></div>
    <p>These are the schedules for the rig ${state.rig}. For those of another rig, choose it at the top.</p>
    ${shown && html`<${Forecast} forecast=${shown} />`}
    <${MakeSchedule} known=${known} saved=${async (made) => { await read(); choose(made); }} />
    ${known.open.length > 0 && html`<details class="broken" open=${broken}><summary>Continue a test that was broken off</summary><p>Its sequencer ended before the test did. It continues at its next repeat; nothing is played twice.</p>
      ${known.open.map((id) => html`<p class="row" key=${id}><strong>${id}</strong> <${Deliberate} label=${`Continue ${id}`} action=${`/api/endurance/${id}/resume`} values=${{}} done=${(answer) => chooseRig(answer.rig)} /></p>`)}</details>`}
  </section>`;
}

function Forecast({ forecast }) {
  return html`<p>${forecast.repeats} repeats on ${forecast.rig}, ${span(forecast.seconds)} of playing, ${(forecast.bytes / 1e6).toFixed(1)} MB on disk before compression.</p>
    ${forecast.rig !== state.rig && html`<p class="notice">It plays on the rig ${forecast.rig}, not on ${state.rig}.</p>`}
    ${forecast.notes.map((note) => html`<p class="notice">${note}</p>`)}
    <div class="beside"><${Table} caption="Events" heads=${["event", "repeats", "one repeat", "kept with all samples", "drive"]} rows=${forecast.events.map(([event, repeats, seconds, kept, source]) => [event, repeats, span(seconds), kept, html`<span class="wrapped">${source}</span>`])} />
    ${forecast.channels.length > 0 && html`<${Table} caption="Damage of the whole schedule" heads=${["response", "damage plan", "planned damage", "ratio"]} rows=${forecast.channels.map(([channel, planned, damage, ratio]) => [channel, figure(planned), figure(damage), figure(ratio)])} />`}</div>
    ${forecast.channels.length > 0 && html`<p>Planned damage: all repeats, each with the damage of the response measured in the campaign of its drive.</p>`}`;
}

const eventName = (id) => id.replace(/[^a-z0-9_]/g, "_").replace(/^[^a-z]+/, "") || "event";

function MakeSchedule({ known, saved }) {
  const [name, setName] = useState("");
  const [order, setOrder] = useState("interleaved");
  const [repeats, setRepeats] = useState({});
  const [wrong, setWrong] = useState("");
  const mine = known.drives.filter((one) => one.rig === state.rig);
  const typed = Object.fromEntries(mine.map((one) => [one.id, typedNumber(repeats[one.id] || "", { least: 1, whole: true })]));
  const events = Object.fromEntries(mine.filter((one) => typed[one.id].value).map((one) => [eventName(one.id), { drive: one.id, repeats: typed[one.id].value, ...(one.result === "reached" ? {} : { missed_target_accepted: true }) }]));
  const save = async () => {
    setWrong("");
    try {
      await post("/api/schedules", { document: { name, rig: state.rig, events, order }, save: true, replace: known.schedules.includes(name) });
      say(`The schedule ${name} is saved.`);
      saved(name);
    } catch (error) { setWrong(error.message); }
  };
  return html`<details class="make"><summary>Make a schedule from the drives of recordings</summary>
    ${mine.length === 0 ? html`<p>There is no recording with a drive for ${state.rig}.</p>` : html`
    <div class="row"><label>Name of the schedule <input name="schedule-name" value=${name} onInput=${(event) => setName(event.target.value)} /></label>
      <label>Order <select name="order" value=${order} onChange=${(event) => setOrder(event.target.value)}>${["interleaved", "in_order", "shuffled"].map((one) => html`<option value=${one}>${one.replace("_", " ")}</option>`)}</select></label>
      <button type="button" id="save-schedule" disabled=${!mayMove() || !name || Object.keys(events).length === 0 || mine.some((one) => typed[one.id].wrong)} onClick=${save}>${known.schedules.includes(name) ? `Replace ${name}` : "Save the schedule"}</button></div>
    <p role="alert" class="wrong">${wrong}</p>
    <${Table} caption="Drives: the best of each recording" heads=${["recording", "result", "repeats"]} rows=${mine.map((one) => [one.id, one.result === "reached" ? "reached" : html`<span class="warn">▲ ${one.result}</span>`,
      html`<input aria-label=${`repeats of ${one.id}`} name=${`repeats-${one.id}`} size="8" inputmode="numeric" value=${repeats[one.id] || ""} onInput=${(event) => setRepeats({ ...repeats, [one.id]: event.target.value.trim() })} /> <small class="wrong" role="alert">${typed[one.id].wrong}</small>`])} />
    <p>Damage plan, limits, actions after an alarm and what is kept have their defaults; the file that <code>duralab schedule design</code> writes has more.</p>`}</details>`;
}
