// Screens that watch: the lab, a rig, a run.
"use strict";
import { chooseRig, described, get, html, isOperator, mayMove, attempt, post, state, targetOf, useEffect, useState } from "/web/lab.js";
import { Deliberate, Legend, Mode, NumberInput, Plot, Table, clock, curve, figure, percent, sentence, share, span, typedNumber } from "/web/parts.js";

// A rig that no longer answers may move.
const motion = (rig) => (rig.age > 3 ? "It is not known whether it moves." : rig.run ? `Plays ${rig.run}, ${share(rig.fraction)}.` : "At rest.");

const choose = (rig, screen) => () => { chooseRig(rig); location.hash = screen; };

export function LabScreen() {
  const { lab } = state;
  const free = lab.services.map((one) => one.free_bytes).find((bytes) => bytes !== null && bytes !== undefined);
  const troubled = lab.services.filter((one) => one.trouble).length;
  return html`<h1>Lab</h1>
    <div class="cards">${lab.rigs.map((rig) => {
      const campaign = lab.campaigns.find((one) => one.rig === rig.name && !one.ended);
      const test = lab.endurance.find((one) => one.rig === rig.name && !one.ended);
      return html`<article class="card" key=${rig.name}><h2><a href="#rig" onClick=${choose(rig.name, "rig")}>${rig.name}</a></h2>
        <p><${Mode} rig=${rig} /></p>
        ${rig.reason && html`<p class="reason">${rig.reason}</p>`}
        <p>${motion(rig)} Last sign of life ${span(rig.age)} ago.</p>
        <p>${rig.holder ? `Held by ${rig.holder.name} since ${clock(rig.holder.since)}.` : "Held by nobody."}</p>
        ${rig.waiting && html`<p>Being made ready: ${rig.waiting}.</p>`}
        ${campaign && html`<p><a href="#run" onClick=${choose(rig.name, "run")}>${campaign.id}</a>: ${campaign.activity}, ${share(campaign.fraction)}${campaign.remaining === null ? "" : `, ${span(campaign.remaining)} left`}</p>
          ${campaign.hold && html`<p class="notice">Waits for a decision.</p>`}`}
        ${test && html`<p><a href="#endurance" onClick=${choose(rig.name, "endurance")}>${test.id}</a>: ${test.silent ? `no word for ${span(test.age)}` : test.phase}, ${test.played} of ${test.repeats} repeats${test.remaining ? `, ${span(test.remaining)} left` : ""}${test.alarms ? `, ${test.alarms} alarms` : ""}</p>
          ${test.hold > 0 && html`<p class="notice">Waits for a decision.</p>`}`}
      </article>`;
    })}</div>
    ${lab.rigs.length === 0 && html`<p class="notice">There is no rig in this lab.</p>`}
    <p>${free === undefined ? "The room on the recorder's disk is not known." : `${(free / 1e9).toFixed(0)} GB are free on the recorder's disk.`}
      ${troubled === 0 ? " All services answer." : ` ${troubled} of ${lab.services.length} services do not answer.`}</p>
    <${Table} caption="Services" heads=${["service", "instance", "up", "state"]}
      rows=${lab.services.map((one) => ({ className: one.trouble ? "bad" : "", cells: [one.service, one.instance, span(one.up), one.trouble || "answers"] }))} />
    <${Log} />`;
}

export function Log({ lines = 40 }) {
  return html`<section class="log" aria-label="Event log"><h2>Event log</h2><ol reversed tabindex="0" aria-label="Events, the newest first">${state.log.slice(-lines).reverse().map((line) => html`
    <li key=${line.number} class=${line.trouble ? "bad" : ""}><time>${clock(line.when)}</time> ${line.trouble ? html`<strong>Trouble: </strong>` : ""}${line.text}${line.who ? html` <span class="who">${line.who}</span>` : ""}</li>`)}</ol></section>`;
}

const limits = (channel) => (channel.minimum === null || channel.maximum === null ? "–"
  : channel.minimum === -channel.maximum ? `± ${figure(channel.maximum)} ${channel.unit}`
    : `${figure(channel.minimum)} … ${figure(channel.maximum)} ${channel.unit}`);

export function RigScreen() {
  const rig = state.lab.rigs.find((one) => one.name === state.rig);
  const [reason, setReason] = useState("");
  const [pulses, setPulses] = useState(0.05);
  if (!rig) return html`<h1>Rig</h1><p class="notice">${state.rig ? `The rig ${state.rig} is not in this lab.` : "There is no rig in this lab."}</p>`;
  const about = described(rig.name);
  const mine = rig.holder && rig.holder.name === state.session.name;
  const sensed = about && about.responses.some((one) => one.sensor);
  const level = (channel, name) => (channel.sensor && channel.sensor[name] ? `${figure(channel.sensor[name])} ${channel.unit}` : "–");
  return html`<h1>Rig ${rig.name}</h1>
    <div class="cards">
      <article class="card"><h2>State</h2><p class="large"><${Mode} rig=${rig} /></p>
        ${rig.reason && html`<p class="reason">${rig.reason}</p>`}
        ${rig.reset && html`<p>${rig.reset}</p>`}
        <p>${motion(rig)} Last sign of life ${span(rig.age)} ago.</p></article>
      <article class="card"><h2>Held by</h2><p>${rig.holder ? html`${rig.holder.name}${mine ? " (you)" : ""} since ${clock(rig.holder.since)}.` : "Nobody; the first person who commands it holds it."}</p>
        ${isOperator() && (mine
          ? html`<button type="button" disabled=${!mayMove()} onClick=${() => attempt(() => post(`/api/rigs/${rig.name}/release`))}>Release</button>`
          : html`<${Deliberate} label=${`Take over ${rig.name}`} action=${`/api/rigs/${rig.name}/take`} values=${{}} />`)}</article>
      ${isOperator() && html`<article class="card"><h2>Reset</h2>
        <p>Look at the rig first. A reset lets it move again; any operator may reset what anybody stopped.</p>
        <div class="row"><label class="wide">Reason <input name="reset-reason" value=${reason} maxlength="300" onInput=${(event) => setReason(event.target.value)} /></label>
        <${Deliberate} label=${`Reset ${rig.name}`} action=${`/api/rigs/${rig.name}/reset`} values=${{ reason: reason.trim() }} ready=${rig.mode === "interlocked" && reason.trim() !== ""} done=${() => setReason("")} /></div></article>`}
      ${isOperator() && html`<article class="card"><h2>Pre-test</h2><p>Small pulses on each drive find dead, swapped and inverted channels. The event log says what is found. On a stiff specimen begin with 0.5 % of the limits.</p>
        <div class="row"><label>Share of the limits <select name="pre-test-level" value=${String(pulses)} onChange=${(event) => setPulses(Number(event.target.value))}>${[0.005, 0.01, 0.02, 0.05].map((one) => html`<option value=${String(one)}>${100 * one} %</option>`)}</select></label>
        <${Deliberate} label=${`Pre-test ${rig.name} at ${100 * pulses} %`} action=${`/api/rigs/${rig.name}/pre_test`} values=${{ level: pulses }} ready=${rig.mode === "idle"} /></div></article>`}
    </div>
    ${about && html`
      <p>${sentence(about.specimen)}. Engine: ${about.engine} ${about.version}. Sample rate: ${figure(about.sample_rate, 5)} Hz. Longest drive: ${span(about.longest_drive_seconds)}.
        ${about.simulated ? " A simulation: nothing real moves." : ""}${about.cannot_be_stopped ? " A run that has begun cannot be stopped." : ""}</p>
      ${about.overdue.map((sentence) => html`<p class="notice">${sentence}</p>`)}
      <${Table} caption="Drives" heads=${["drive", "limits", "rate limit", "what it is"]}
        rows=${about.drives.map((one) => [one.name, limits(one), one.slew_limit ? `${figure(one.slew_limit)} ${one.unit}/s` : "–", html`<span class="wrapped">${one.label}</span>`])} />
      <${Table} caption="Responses" heads=${["response", "limits", "watchdog", ...(sensed ? ["warning", "abort", "sensor", "calibration due"] : []), "what it is"]}
        rows=${about.responses.map((one) => [one.name, limits(one), one.watchdog ? `${figure(one.watchdog)} ${one.unit}` : "–",
          ...(sensed ? [level(one, "warning_level"), level(one, "abort_level"), (one.sensor && one.sensor.serial_number) || "–", (one.sensor && one.sensor.calibration_due) || "–"] : []), html`<span class="wrapped">${one.label}</span>`])} />`}
    ${state.session.viewer && html`<h2>In 3-D</h2><p>The viewer may be late, and says by how much; the state above is what holds.</p><iframe title="Rig in 3-D" src=${state.session.viewer}></iframe>`}`;
}

export function RunScreen() {
  const campaigns = state.lab.campaigns.filter((one) => one.rig === state.rig);
  const campaign = campaigns.filter((one) => !one.ended).pop() || campaigns.pop();
  const rig = state.lab.rigs.find((one) => one.name === state.rig);
  return html`<h1>Run ${campaign ? campaign.id : ""} ${rig && html`<${Mode} rig=${rig} />`}</h1>
    ${rig && rig.reason && html`<p class="reason">${rig.reason}</p>`}
    ${rig && rig.waiting && html`<p class="notice">Being made ready: ${rig.waiting}.</p>`}
    ${campaign && html`
      <p class="activity">${sentence(campaign.activity)}${campaign.ended ? "" : html` — ${share(campaign.fraction)} done${campaign.remaining === null ? "" : `, ${span(campaign.remaining)} left`}`}</p>
      <progress max="1" value=${campaign.fraction} aria-label="Share of the campaign that is done"></progress>
      ${campaign.ended && isOperator() && html`<p class="row resume">Continue from its last playback, as a new campaign: <${Deliberate} label=${`Resume ${campaign.id} on ${campaign.rig}`} action=${`/api/campaigns/${campaign.id}/resume`} values=${{ from_iteration: 0 }} />
        <a href="#recordings">Report and recording</a></p>`}
      ${campaign.hold && html`<${Hold} campaign=${campaign} key=${`${campaign.id}-${campaign.hold.number}`} />`}
      ${campaign.table && html`<${Iterations} table=${campaign.table} />`}`}
    ${(!campaign || campaign.ended) && !(rig && rig.waiting) && html`<${Begin} key=${state.rig} />`}
    <${Curves} campaign=${campaign} />
    <${Log} lines=${15} />`;
}

function Begin() {
  const [known, setKnown] = useState(null);
  const [chosen, setChosen] = useState("");
  useEffect(() => { attempt(async () => setKnown(await get("/api/campaign_files"))); }, []);
  if (!state.rig) return html`<p class="notice">There is no rig in this lab.</p>`;
  if (!isOperator()) return html`<p>No campaign runs on this rig.</p>`;
  if (!known) return html`<p>Reading the campaigns …</p>`;
  const [kind, name] = chosen.split(":");
  const rigs = known.unavailable[chosen] ? [] : known.rigs[chosen] || [];
  const ofRig = (of, names) => names.map((one) => [one, `${of}:${one}`]).filter(([, key]) => !known.rigs[key] || known.rigs[key][0] === state.rig);
  const why = (key) => (known.unavailable[key] ? " (unavailable)" : known.rigs[key] ? "" : " (cannot be read; see New test)");
  const options = (of, names) => ofRig(of, names).map(([one, key]) => html`<option value=${key} disabled=${why(key) !== ""}>${one}${why(key)}</option>`);
  const unavailable = [...ofRig("file", known.files), ...ofRig("shipped", known.shipped)].filter(([, key]) => known.unavailable[key]);
  return html`<section class="card" aria-label="Begin a campaign"><h2>Begin a campaign</h2>
    <div class="row"><label>Campaign <select name="campaign" value=${chosen} onChange=${(event) => setChosen(event.target.value)}>
      <option value="">choose …</option>
      <optgroup label="Files of this page">${options("file", known.files)}</optgroup>
      <optgroup label="Shipped">${options("shipped", known.shipped)}</optgroup></select></label>
    <${Deliberate} label=${chosen ? `Begin ${name} on ${rigs.join(" and ")}` : "Begin"} action="/api/campaigns" values=${{ kind, name, rigs }} ready=${rigs.length > 0} done=${(answer) => chooseRig(answer.rig)} /></div>
    <p>These are the campaigns for the rig ${state.rig}. For those of another rig, choose it at the top.</p>
    ${unavailable.map(([one, key]) => html`<p class="unavailable" key=${key}><strong>${one}</strong> is unavailable. ${known.unavailable[key]}</p>`)}</section>`;
}

function Iterations({ table }) {
  const rows = table.numbers.map((number, row) => ({
    className: number === table.best ? "best" : "",
    cells: [`${number}${number === table.best ? " ★ best" : ""}`, share(table.level[row]), percent(table.overall[row]),
      ...table.channels.map((_, column) => html`${percent(table.error[row][column])} <span class="second">${figure(table.damage[row][column])}</span>`)],
  }));
  const points = [table.numbers, table.overall.map((error) => (error === null ? null : 100 * error))];
  return html`<div class="iterations"><${Table} caption="Iterations: relative RMS error, and damage ratio (slope 5) in small" className="figures"
      heads=${["playback", "level", "overall", ...table.channels.map((name, i) => name + (table.watched[i] ? " (monitored)" : ""))]} rows=${rows} />
    ${table.numbers.length > 1 && html`<${Plot} title="Overall error" unit="%" xLabel="playback" changes=${points[0].length} curves=${[{ name: "error", colour: "--response", width: 2, data: points }]} />`}</div>`;
}

function Curves({ campaign }) {
  const run = state.signals[state.rig];
  const about = described(state.rig);
  const [kind, setKind] = useState("response");
  if (!run || !about) return null;
  const isIteration = campaign && run.run.startsWith(`${campaign.id}.i`);
  const target = isIteration && kind === "response" ? targetOf(campaign.id) : null;
  const channels = kind === "response" ? about.responses : about.drives;
  return html`<section aria-label="Signals"><h2>Signals of ${run.run}${run.over ? " (played)" : ""}</h2>
    <div class="row"><label>Show <select value=${kind} onChange=${(event) => setKind(event.target.value)}><option value="response">responses</option><option value="drive">drives</option></select></label>
      <${Legend} curves=${target ? [["target", "target"], ["response, both without their static part", "response"]] : [[kind, "response"]]} /></div>
    <div class="plots">${channels.map((channel, row) => {
      const [low, high] = run[kind];
      const rest = target ? about.rest[row] || 0 : 0;
      const above = (values) => (rest ? values.map((value) => (value === null ? null : value - rest)) : values);
      const curves = [{ name: kind, colour: "--response", data: curve(above(low[row] || []), above(high[row] || []), run.bucket_seconds) }];
      if (target) curves.unshift({ name: "target", colour: "--target", width: 2, data: curve(target.low[row], target.high[row], target.bucket_seconds) });
      return html`<${Plot} key=${`${kind} ${channel.name}`} title=${channel.name} unit=${channel.unit} curves=${curves} changes=${`${run.run} ${run.changes}`} />`;
    })}</div></section>`;
}

const KINDS = [["play", "Play this drive"], ["change", "Change settings and make the drive again"], ["back", "Go back to an earlier playback"], ["end", "End the campaign"]];

function Hold({ campaign }) {
  const { hold } = campaign;
  const [kind, setKind] = useState("play");
  const [reason, setReason] = useState("");
  const [gain, setGain] = useState("");
  const [low, setLow] = useState("");
  const [high, setHigh] = useState("");
  const [from, setFrom] = useState(String(Math.max(1, hold.follows)));
  const [curves, setCurves] = useState(null);
  useEffect(() => { attempt(async () => setCurves(await get(`/api/campaigns/${campaign.id}/proposal`))); }, []);
  const typed = { gain: typedNumber(gain, { most: 1 }), low: typedNumber(low), high: typedNumber(high), from: typedNumber(from, { least: 1, whole: true, required: true }) };
  const wrong = { change: typed.gain.wrong || typed.low.wrong || typed.high.wrong, back: typed.from.wrong }[kind];
  const isGiven = (one) => one.value !== undefined;
  const band = { ...(isGiven(typed.low) && { lowest_frequency: typed.low.value }), ...(isGiven(typed.high) && { highest_frequency: typed.high.value }) };
  const settings = { ...(isGiven(typed.gain) && { update: { iteration_gain: typed.gain.value } }), ...(Object.keys(band).length > 0 && { control_band: band }) };
  const values = { kind, proposal: hold.number, reason: reason.trim(), ...(kind === "change" && { settings }), ...(kind === "back" && { from_iteration: typed.from.value }) };
  const ready = reason.trim() !== "" && !wrong && !(kind === "play" && hold.refusal) && !(kind === "change" && Object.keys(settings).length === 0);
  const about = described(campaign.rig);
  const unit = (name) => about?.drives.find((one) => one.name === name)?.unit ?? "";
  const label = kind === "play" ? `Play this drive on ${campaign.rig}` : KINDS.find(([one]) => one === kind)[1];
  return html`<section class="hold" aria-label="Hold point"><h2>Decide: the drive of playback ${hold.playback}, ${hold.follows ? `made from playback ${hold.follows}` : "the first"}</h2>
    <p>${hold.reason}. Predicted error over all controlled responses: <strong>${percent(hold.overall)}</strong>, at ${share(hold.level)} of the target.</p>
    ${hold.refusal && html`<p class="notice">No drive could be made with the settings in use: ${hold.refusal}</p>`}
    ${hold.remarks.map((remark) => html`<p class="notice">${remark}</p>`)}
    <div class="beside"><${Table} caption="Next drive" heads=${["drive", "peak", "of its range", "slew", "of its limit", "change"]}
      rows=${hold.drives.map((one) => [one.channel, `${figure(one.peak)} ${unit(one.channel)}`, html`${share(one.range_share)} <meter min="0" max="1" high="0.9" value=${one.range_share} aria-label=${`share of the range of ${one.channel}`}></meter>`, `${figure(one.slew)} ${unit(one.channel)}/s`, one.slew_share ? share(one.slew_share) : "–", share(one.change)])} />
    <${Table} caption="Prediction" heads=${["response", "error", "peak ratio", "damage ratio", "uncertainty of the error"]}
      rows=${hold.responses.map((one) => [one.channel, percent(one.error), figure(one.peak), figure(one.damage), one.uncertainty === null ? "unknown" : `± ${percent(one.uncertainty)}`])} /></div>
    ${isOperator() && html`<form onSubmit=${(event) => event.preventDefault()}>
      <fieldset><legend>Decision</legend>${KINDS.map(([one, words]) => html`<label class="choice"><input type="radio" name="decision" value=${one} checked=${kind === one} onChange=${() => setKind(one)} /> ${words}</label>`)}</fieldset>
      ${kind === "change" && html`<div class="row"><${NumberInput} label="Iteration gain, 0 to 1" name="gain" text=${gain} change=${setGain} typed=${typed.gain} />
        <${NumberInput} label="Control band from, Hz" name="low" text=${low} change=${setLow} typed=${typed.low} />
        <${NumberInput} label="to, Hz" name="high" text=${high} change=${setHigh} typed=${typed.high} /></div>`}
      ${kind === "back" && html`<${NumberInput} label="Playback to make the next drive from" name="from" text=${from} change=${setFrom} typed=${typed.from} />`}
      <div class="row"><label>Reason, kept in the recording <input class="reason-field" name="reason" value=${reason} maxlength="500" onInput=${(event) => setReason(event.target.value)} /></label>
      <${Deliberate} label=${label} action=${`/api/campaigns/${campaign.id}/decide`} values=${values} ready=${ready} /></div></form>`}
    ${!curves ? html`<p role="status">Reading the drive and the prediction …</p>` : html`<${Foreseen} campaign=${campaign} curves=${curves} />`}
  </section>`;
}

// The next drive over the last one, and the predicted response over the target.
function Foreseen({ campaign, curves }) {
  const { drive, last_drive: last, predicted } = curves;
  const { hold } = campaign;
  const target = targetOf(campaign.id);
  const about = described(state.rig);
  if (!drive) return null;
  const drawn = (name, colour, from, row, width) => ({ name, colour, width, data: curve(from.low[row], from.high[row], from.bucket_seconds) });
  return html`<details open><summary>Next drive${last ? ` over that of playback ${hold.follows}` : ""}</summary>
      ${hold.follows > 0 && !last && html`<p>No samples of playback ${hold.follows} are recorded, so that its drive is not drawn.</p>`}
      <${Legend} curves=${[...(last ? [[`drive of playback ${hold.follows}`, "target"]] : []), ["next drive", "response"]]} />
      <div class="plots">${drive.channels.map((channel, row) => html`<${Plot} key=${channel.name} title=${`${channel.name}${hold.drives[row] && last ? `, change ${share(hold.drives[row].change)}` : ""}`} unit=${channel.unit} changes=${`${hold.number} ${Boolean(last)}`}
        curves=${[...(last ? [drawn("last drive", "--target", last, row, 2)] : []), drawn("next drive", "--response", drive, row, 1)]} />`)}</div></details>
    ${predicted && target && about && html`<details open><summary>Predicted response over the target</summary>
      <${Legend} curves=${[["target, without its static part", "target"], ["predicted, in the control band", "response"]]} />
      <div class="plots">${hold.responses.map((one, row) => {
        const place = about.responses.findIndex((channel) => channel.name === one.channel);
        return html`<${Plot} key=${one.channel} title=${`${one.channel}: error ${percent(one.error)}, damage ${figure(one.damage)}`} unit=${about.responses[place] ? about.responses[place].unit : ""} changes=${hold.number}
          curves=${[drawn("target", "--target", target, place, 2), drawn("predicted", "--response", predicted, row, 1)]} />`;
      })}</div></details>`}`;
}
