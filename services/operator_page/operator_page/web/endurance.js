// An endurance test: how far it is, damage against plan, trends with limits, alarms, and what people decide.
"use strict";
import { attempt, described, get, html, isOperator, state, useEffect, useState } from "/web/lab.js";
import { Deliberate, Legend, Plot, Table, curve, figure, moment, sentence, share, span } from "/web/parts.js";
import { Log } from "/web/screens.js";
import { BeginEndurance } from "/web/schedule.js";

// Colour is never the only sign: each phase and each level has a word and a shape.
const PHASES = { checking: "…", playing: "▶", holding: "❚❚", iterating: "↻", finished: "✓", stopped: "■", faulted: "✕" };
const LEVELS = { warning: "▲", abort: "◆" };
const WORDS = { min: "minimum", max: "maximum", mean: "mean", rms: "RMS", std: "standard deviation", damage: "damage", residual: "residual against the baseline" };

export function EnduranceScreen() {
  const tests = state.lab.endurance.filter((one) => one.rig === state.rig);
  const test = tests.filter((one) => !one.ended).pop() || tests.pop();
  const rig = state.lab.rigs.find((one) => one.name === state.rig);
  const [asked, setAsked] = useState({ event: "", statistic: "rms" });
  const [details, setDetails] = useState(null);
  const events = test ? test.events.map(([name]) => name) : [];
  const event = events.includes(asked.event) ? asked.event : events[0] || "";
  const id = test ? test.id : "";
  useEffect(() => {
    let gone = false;
    if (id && event) attempt(async () => { const found = await get(`/api/endurance/${id}?event=${event}&statistic=${asked.statistic}`); if (!gone) setDetails({ id, ...found }); });
    return () => { gone = true; };
  }, [id, event, asked.statistic, test && test.read, test && test.ended]);
  const known = details && details.id === id ? details : null;
  return html`<h1>Endurance ${id} ${test && html`<${Phase} test=${test} />`}</h1>
    ${rig && rig.reason && html`<p class="reason">${rig.reason}</p>`}
    ${rig && rig.waiting && html`<p class="notice">Being made ready: ${rig.waiting}.</p>`}
    ${test && html`
      <p class="activity"><strong>${test.played}</strong> of ${test.repeats} repeats${test.remaining ? html`, <strong>${span(test.remaining)}</strong> left` : ""}. ${test.hold ? "It waits for a decision" : sentence(test.activity).replace(/\.$/, "")}.</p>
      <progress max=${Math.max(1, test.repeats)} value=${test.played} aria-label="Share of the repeats that is played"></progress>
      ${test.silent && html`<p class="notice">The sequencer of this test is not heard; what stands here is old. When the sequencer runs again, continue the test here.</p><${BeginEndurance} key=${state.rig} broken />`}
      ${test.ended && test.reason && html`<p class="reason">${test.reason}</p>`}
      ${test.hold > 0 && html`<${Waiting} test=${test} key=${`${id}-${test.hold}`} />`}
      ${!test.ended && !test.hold && isOperator() && html`<${Acting} test=${test} key=${id} />`}
      ${test.remarks.slice(-3).map((remark) => html`<p class="notice">${remark}</p>`)}
      <div class="beside"><${Schedule} test=${test} known=${known} /><${Damage} test=${test} /></div>
      ${known && known.curves && html`<${Trends} test=${test} known=${known} event=${event} statistic=${asked.statistic} choose=${setAsked} />`}
      <${Alarms} test=${test} known=${known} />
      ${known && known.curves && html`<${Kept} test=${test} known=${known} />`}`}
    ${(!test || test.ended) && !(rig && rig.waiting) && html`<${BeginEndurance} key=${state.rig} />`}
    <${Log} lines=${15} />`;
}

function Phase({ test }) {
  if (test.silent) return html`<span class="mode mode-unknown"><span aria-hidden="true">?</span> no word for ${span(test.age)}</span>`;
  return html`<span class="mode phase-${test.phase}"><span aria-hidden="true">${PHASES[test.phase]}</span> ${test.phase}</span>`;
}

const CHOICES = [["continue", "Continue"], ["iterate_again", "Iterate again, then continue with the corrected drive"], ["relearn", "Learn all baselines again, as after a repair, and continue"], ["end", "End the test; the rig is not latched"]];

function Waiting({ test }) {
  const [kind, setKind] = useState("continue");
  const [reason, setReason] = useState("");
  const label = `${CHOICES.find(([one]) => one === kind)[1].split(/[,;]/)[0]} (${test.id} on ${test.rig})`;
  return html`<section class="hold" aria-label="Hold"><h2>Hold ${test.hold}: ${test.hold_alarms ? "because of an alarm" : "a person or a fault made it wait"}</h2>
    <p>${test.reason}</p>
    ${isOperator() && html`<form onSubmit=${(event) => event.preventDefault()}>
      <fieldset><legend>Decision</legend>${CHOICES.map(([one, words]) => html`<label class="choice"><input type="radio" name="decision" value=${one} checked=${kind === one} onChange=${() => setKind(one)} /> ${words}</label>`)}</fieldset>
      <div class="row"><label>Reason, kept in the recording <input class="reason-field" name="reason" value=${reason} maxlength="500" onInput=${(event) => setReason(event.target.value)} /></label>
      <${Deliberate} label=${label} action=${`/api/endurance/${test.id}/decide`} values=${{ kind, hold: test.hold, reason: reason.trim() }} ready=${reason.trim() !== ""} /></div></form>`}
  </section>`;
}

function Acting({ test }) {
  const [reason, setReason] = useState("");
  const values = { reason: reason.trim() };
  const ready = reason.trim() !== "";
  return html`<form class="row acting" onSubmit=${(event) => event.preventDefault()}><label>Reason of a hold or stop <input class="reason-field" name="hold-reason" value=${reason} maxlength="500" onInput=${(event) => setReason(event.target.value)} /></label>
    <${Deliberate} label=${`Hold ${test.id} after this repeat`} action=${`/api/endurance/${test.id}/hold`} values=${values} ready=${ready} done=${() => setReason("")} />
    <${Deliberate} label=${`Stop the test ${test.id} on ${test.rig}`} action=${`/api/endurance/${test.id}/stop`} values=${values} ready=${ready} done=${() => setReason("")} /></form>`;
}

function Schedule({ test, known }) {
  const order = known && known.order ? `, ${known.order.replace("_", " ")}` : "";
  return html`<${Table} caption=${`Schedule${order}`} heads=${["event", "played", "planned", "done", "drive"]}
    rows=${test.events.map(([name, played, planned]) => [name, played, planned, html`${share(planned ? played / planned : null)} <meter min="0" max=${Math.max(1, planned)} value=${played} aria-label=${`share of ${name} that is played`}></meter>`,
      html`<span class="wrapped">${known && known.sources ? known.sources[name] : "–"}</span>`])} />`;
}

function Damage({ test }) {
  const off = (ratio) => ratio !== null && (ratio > 1.2 || ratio < 0.8);
  const corrected = test.correction_playbacks > 0;
  return html`<div><${Table} caption="Damage against plan" heads=${["response", "counted", ...(corrected ? ["of it by corrections"] : []), "planned so far", "over planned so far", "over planned in all"]}
    rows=${test.damage.map(([name, counted, planned, whole]) => {
      const ratio = planned ? counted / planned : null;
      return { className: off(ratio) ? "off" : "", cells: [name, figure(counted), ...(corrected ? [figure(test.correction_damage[name])] : []), figure(planned), html`${off(ratio) ? html`<span aria-hidden="true">${ratio > 1 ? "↑" : "↓"}</span> ` : ""}${share(ratio)}`,
        html`${share(whole ? counted / whole : null)} ${whole ? html`<meter min="0" max="1" value=${counted / whole} aria-label=${`share of the planned damage of ${name}`}></meter>` : ""}`] };
    })} /><p>Planned: each repeat with the damage of the response measured in the campaign of its drive.</p></div>`;
}

// Limits as steps over the repeats: each counts from its first repeat to that of the next of its kind.
function limitCurves(limits, row, last) {
  const curves = {};
  limits.forEach((one) => {
    for (const side of ["low", "high"]) {
      if (one[side][row] === null) continue;
      const key = `${one.name} ${side}`;
      curves[key] = curves[key] || { name: key, colour: one.name.endsWith("abort") ? "--bad" : "--warn", dash: one.name.endsWith("abort") ? [2, 3] : [8, 4], width: 1.5, data: [[], []] };
      const [x, y] = curves[key].data;
      if (x.length) { x.push(Math.max(x[x.length - 1] + 0.01, one.first - 0.5)); y.push(y[y.length - 1]); }
      x.push(x.length ? x[x.length - 1] + 0.01 : one.first); y.push(one[side][row]);
    }
  });
  Object.values(curves).forEach(({ data: [x, y] }) => { x.push(Math.max(last, x[x.length - 1] + 0.01)); y.push(y[y.length - 1]); });
  return Object.values(curves);
}

function Trends({ test, known, event, statistic, choose }) {
  const about = described(state.rig);
  const { curves } = known;
  const unit = (row) => (statistic === "residual" ? "share of the RMS" : about && about.responses[row] ? (statistic === "damage" ? "damage" : about.responses[row].unit) : "");
  const last = Math.max(2, test.played);
  const absent = curves.limits.length === 0;
  return html`<section aria-label="Trends"><h2>Trends</h2>
    <div class="row"><label>Event <select name="event" value=${event} onChange=${(change) => choose({ event: change.target.value, statistic })}>${test.events.map(([name]) => html`<option value=${name}>${name}</option>`)}</select></label>
      <label>Statistic <select name="statistic" value=${statistic} onChange=${(change) => choose({ event, statistic: change.target.value })}>${known.statistics.map((one) => html`<option value=${one}>${WORDS[one]}</option>`)}</select></label>
      <${Legend} curves=${[[`${WORDS[statistic]} of each repeat`, "response"], ["warning limit", "warning"], ["abort limit", "abort"], ["alarm", "alarm"]]} /></div>
    ${curves.learning !== null && statistic !== "residual" && html`<p>The baseline of ${event} is being learnt: ${curves.learning} of ${curves.baseline_repeats} repeats.${absent ? " Its limits follow." : ""}</p>`}
    ${statistic === "residual" && absent && html`<p>A change that noise does not explain is an alarm; no fixed limit is given.</p>`}
    <div class="plots">${known.responses.map((name, row) => {
      const [low, high] = [curves.low[row] || [], curves.high[row] || []];
      const drawn = [{ name: WORDS[statistic], colour: "--response", width: 1.5, points: true, data: curves.bucket === 1 ? [low.map((_, i) => i), high] : curve(low, high, curves.bucket) }, ...limitCurves(curves.limits, row, last)];
      const found = known.alarms.filter((one) => one.channel === name && one.event === event).sort((a, b) => a.repeat - b.repeat);
      const at = [...new Map(found.map((one) => [one.repeat, high[Math.floor(one.repeat / curves.bucket)]]))];
      if (at.length) drawn.push({ name: "alarm", colour: "--bad", marks: true, data: [at.map(([x]) => x), at.map(([, y]) => y)] });
      return html`<${Plot} key=${`${name} ${statistic}`} title=${name} unit=${unit(row)} xLabel="repeat" lines=${known.responses.length > 6 ? 8 : 12} curves=${drawn} changes=${`${known.read} ${event} ${statistic}`} />`;
    })}</div></section>`;
}

const band = (one) => (one.band ? `${figure(one.band[0])} to ${figure(one.band[1])} Hz` : "–");
const size = (one) => (one.kind === "limit" && /outside/.test(one.sentence) ? figure(one.size) : `${one.size > 0 ? "+" : ""}${(100 * one.size).toFixed(1)} %`);

function Alarms({ test, known }) {
  const alarms = known && known.alarms ? [...known.alarms].reverse() : [];
  if (test.alarms === 0) return html`<p class="good">✓ No alarm so far.</p>`;
  return html`<${Table} caption=${`Alarms: ${test.alarms}, the newest first${alarms.length < test.alarms && known ? `; ${alarms.length} are shown` : ""}`}
    heads=${["level", "time", "repeat", "event", "channel", "frequency", "measure", "change", "kind", "follows"]}
    rows=${alarms.map((one) => ({ className: one.level === "abort" ? "bad" : "warn", cells: [html`<span class="level"><span aria-hidden="true">${LEVELS[one.level]}</span> ${one.level}</span>`, one.found ? moment(one.found) : "not recorded", one.repeat, one.event, one.channel, band(one), one.measure, size(one), one.kind === "limit" ? "limit" : `${one.kind} since ${one.since}`, one.action] }))} />`;
}

function Kept({ test, known }) {
  const { keep } = known;
  return html`<div class="beside"><section aria-label="What was kept"><h2>What was kept</h2>
      <p>The recording <strong>${test.recording || test.id}</strong> has the statistics of all ${test.played} repeats, and all samples of ${test.kept}. All samples are kept of the first ${keep.first === 1 ? "repeat" : `${keep.first} repeats`} of each event, ${keep.every ? `of one in ${keep.every}, ` : ""}and of ${keep.around} before and after an alarm.</p>
      ${known.kept.length > 0 && html`<details><summary>Repeats with all samples${known.kept.length < test.kept ? ", the last ones" : ""}</summary><p class="wrapped">${known.kept.join(", ")}</p></details>`}
      ${known.unknown.map(([, reason]) => html`<p class="notice">${reason}</p>`)}</section>
    ${known.decisions.length > 0 && html`<${Table} caption="Decisions" heads=${["hold", "decision", "by", "reason"]} rows=${known.decisions.map(([hold, kind, name, reason]) => [hold, kind, name || "the schedule", html`<span class="wrapped">${reason}</span>`])} />`}</div>`;
}
