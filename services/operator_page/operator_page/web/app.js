// The frame around every screen: where one is, who one is, whether the stream lives, and the stop.
"use strict";
import { changed, chooseRig, html, isOperator, refresh, say, signIn, signInByCertificate, signOut, state, stop, useEffect, useLab, useState } from "/web/lab.js";
import { LabScreen, RigScreen, RunScreen } from "/web/screens.js";
import { EnduranceScreen } from "/web/endurance.js";
import { NewTestScreen } from "/web/new_test.js";
import { RecordingsScreen } from "/web/recordings.js";

const SCREENS = [["lab", "Lab", LabScreen], ["rig", "Rig", RigScreen], ["run", "Run", RunScreen], ["endurance", "Endurance", EnduranceScreen], ["new", "New test", NewTestScreen], ["recordings", "Recordings", RecordingsScreen]];

const isAbsent = () => state.rig && !state.lab.rigs.some((rig) => rig.name === state.rig);

function here() {
  return SCREENS.find(([key]) => `#${key}` === location.hash) || SCREENS[0];
}

function setTheme(theme) {
  state.theme = theme;
  localStorage.setItem("theme", theme);
  document.documentElement.dataset.theme = theme;
  changed();
}

function SignIn() {
  const [name, setName] = useState("");
  const [password, setPassword] = useState("");
  const [wrong, setWrong] = useState("");
  const submit = async (event) => {
    event.preventDefault();
    try { await signIn(name, password); } catch (error) { setWrong(error.message); }
    setPassword("");
  };
  const { certificate } = state.session;
  const show = async () => { try { await signInByCertificate(); } catch (error) { setWrong(error.message); } };
  return html`<main class="sign-in"><h1>Duralab</h1><form onSubmit=${submit}>
    <label>Name <input autocomplete="username" value=${name} onInput=${(event) => setName(event.target.value)} required /></label>
    <label>Password <input type="password" autocomplete="current-password" value=${password} onInput=${(event) => setPassword(event.target.value)} required /></label>
    <button type="submit">Sign in</button>
    ${certificate && html`<button type="button" id="by-certificate" onClick=${show}>Sign in with the certificate ${certificate}</button>`}
    <p role="alert">${wrong}</p></form></main>`;
}

function StopButton() {
  if (!isOperator()) return html`<p class="viewer">You watch only. To stop the rig, use its emergency stop or call an operator.</p>`;
  return html`<div class="stop" role="group" aria-label="Stop">
    <button type="button" id="stop" onClick=${() => stop(state.rig)}>STOP ${state.rig || "all"}<small><span class="by-key">key F9 · </span>this is no emergency stop</small></button>
    <button type="button" id="stop-all" onClick=${() => stop("")}>Stop all rigs</button></div>`;
}

function Banner() {
  if (state.reload) return html`<div class="banner" role="alert">This page is older than its service. <button type="button" onClick=${() => location.reload()}>Reload it</button> Until then nothing can be started.</div>`;
  if (!state.live) return html`<div class="banner" role="alert"><strong>No contact with the lab.</strong> What stands here is old; nothing can be started from this page. To stop a rig now, use its emergency stop.</div>`;
  return null;
}

function Page() {
  useLab();
  const [, setHash] = useState("");
  useEffect(() => {
    const moved = () => { setHash(location.hash); document.getElementById("content")?.focus({ preventScroll: true }); scrollTo(0, 0); };
    const key = (event) => {
      if (event.key === "F9") { event.preventDefault(); if (isOperator() && !event.repeat) stop(state.rig); return; }
      const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
      const number = Number(event.key);
      if (!typing && !event.ctrlKey && !event.altKey && !event.metaKey && number >= 1 && number <= SCREENS.length) location.hash = SCREENS[number - 1][0];
    };
    addEventListener("hashchange", moved);
    addEventListener("keydown", key);
    return () => { removeEventListener("hashchange", moved); removeEventListener("keydown", key); };
  }, []);
  if (!state.session) return html`<main class="sign-in"><p role="status">Joining the lab …</p></main>`;
  if (!state.session.name) return html`<${SignIn} />`;
  const [current, title, Screen] = here();
  document.title = `${title} ${state.rig} – Duralab`;
  return html`<a class="skip" href="#content" onClick=${(event) => { event.preventDefault(); document.getElementById("content").focus(); }}>To the content</a>
    <header><div class="where"><nav aria-label="Screens">${SCREENS.map(([key, name], i) => html`<a href=${`#${key}`} aria-current=${key === current ? "page" : undefined} title=${`key ${i + 1}`}>${name}</a>`)}</nav>
      ${state.lab && html`<label class="rig-choice">Rig <select value=${state.rig} onChange=${(event) => chooseRig(event.target.value)}>${isAbsent() && html`<option value=${state.rig}>${state.rig} (not in the lab)</option>`}${state.lab.rigs.map((rig) => html`<option value=${rig.name}>${rig.name}</option>`)}</select></label>`}
      <p class="status" data-when=${state.lab && state.lab.now}><span class=${state.live ? "live" : "lost"}>${state.live ? "● live" : "✕ no contact"}</span> ${state.session.name} (${state.session.role})
        ${state.session.accounts && html` <button type="button" onClick=${signOut}>Sign out</button>`}
        <button type="button" id="theme" onClick=${() => setTheme(dark() ? "light" : "dark")}>${dark() ? "Light" : "Dark"}</button></p></div>
      <${StopButton} />
      <p class="said ${state.said ? "told" : ""} ${state.said && state.said.trouble ? "bad" : ""}" role="status" aria-live="polite">${state.said ? state.said.text : ""}
        ${state.said && html` <button type="button" class="close" aria-label="Close the message" onClick=${() => { state.said = null; changed(); }}>✕</button>`}</p></header>
    <${Banner} />
    <main id="content" tabindex="-1" class=${state.live ? "" : "old"}>${state.lab ? html`<${Screen} key=${current} />` : html`<p role="status">Joining the lab …</p>`}</main>`;
}

const system = matchMedia("(prefers-color-scheme: dark)");
const dark = () => (state.theme ? state.theme === "dark" : system.matches);
system.addEventListener("change", changed);

if (state.theme) document.documentElement.dataset.theme = state.theme;
addEventListener("error", (event) => say(`The page failed: ${event.message}. Reload it.`, true));
self.preact.render(html`<${Page} />`, document.getElementById("page"));
refresh();
