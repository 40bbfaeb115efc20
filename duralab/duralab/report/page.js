"use strict";
(() => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const root = document.documentElement;
  const preference = window.matchMedia("(prefers-color-scheme: dark)");
  let chosenTheme = null;

  const applyTheme = (theme) => { root.dataset.theme = theme; };
  const wantedTheme = () => chosenTheme ?? (preference.matches ? "dark" : "light");

  // A colour "@name" is a colour of the page, so that figures follow the theme.
  const resolve = (node, style) => {
    if (typeof node === "string") return node.startsWith("@") ? style.getPropertyValue("--" + node.slice(1)).trim() : node;
    if (Array.isArray(node)) return node.map((item) => resolve(item, style));
    if (node === null || typeof node !== "object" || "bdata" in node) return node;
    return Object.fromEntries(Object.entries(node).map(([key, value]) => [key, resolve(value, style)]));
  };

  const axis = (given, style) => ({
    gridcolor: style.getPropertyValue("--line").trim(), zerolinecolor: style.getPropertyValue("--line").trim(),
    linecolor: style.getPropertyValue("--line").trim(), automargin: true, ticks: "", ...given,
    title: { standoff: 8, ...(given.title ?? {}), font: { size: 12 } },
  });

  const nameOf = ({ dataset }) => dataset.value === "" ? dataset.kind : `${dataset.kind}-${dataset.value}`;

  const draw = (element) => {
    const style = getComputedStyle(root);
    const figure = resolve(figures[nameOf(element)], style);
    const layout = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: style.getPropertyValue("--text").trim() },
      margin: { l: 52, r: 10, t: figure.layout.title ? 34 : 10, b: 40 }, hovermode: "closest",
      showlegend: element.dataset.legend !== "no",
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, font: { size: 12 } },
      hoverlabel: { namelength: -1 }, dragmode: "zoom",
      ...figure.layout, autosize: true,
    };
    if (layout.title) layout.title = { font: { size: 14 }, x: 0.5, ...layout.title };
    for (const key of Object.keys(layout)) if (/^[xy]axis\d*$/.test(key)) layout[key] = axis(layout[key], style);
    const config = { responsive: true, displayModeBar: false };
    return Plotly.react(element, figure.data, layout, config);
  };
  const plots = [...document.querySelectorAll(".plot")];
  const drawAll = () => Promise.all(plots.map(draw));

  const choose = (group, value) => {
    for (const plot of plots) if (plot.dataset.chosen === group) { plot.dataset.value = value; draw(plot); }
    for (const button of document.querySelectorAll(`button[data-chooses="${group}"]`)) {
      button.setAttribute("aria-pressed", String(button.value === value));
    }
  };
  for (const select of document.querySelectorAll("select[data-chooses]")) {
    select.addEventListener("change", () => choose(select.dataset.chooses, select.value));
  }
  for (const button of document.querySelectorAll("button[data-chooses]")) {
    button.addEventListener("click", () => choose(button.dataset.chooses, button.value));
  }

  // What a mouse does by dragging, the keyboard does by arrows, + and -, and 0 for the whole.
  const steps = { ArrowLeft: [-0.2, 1], ArrowRight: [0.2, 1], "+": [0, 0.5], "-": [0, 2] };
  for (const plot of document.querySelectorAll(".plot[tabindex]")) {
    plot.addEventListener("keydown", (event) => {
      if (event.key !== "0" && !(event.key in steps)) return;
      event.preventDefault();
      if (event.key === "0") { Plotly.relayout(plot, { "xaxis.autorange": true }); return; }
      const [shift, stretch] = steps[event.key];
      const [first, last] = plot.layout.xaxis.range;
      const centre = (first + last) / 2 + shift * (last - first), half = (last - first) / 2 * stretch;
      Plotly.relayout(plot, { "xaxis.range": [centre - half, centre + half] });
    });
  }

  const retheme = () => { applyTheme(wantedTheme()); drawAll(); };
  document.getElementById("theme").addEventListener("click", () => {
    chosenTheme = wantedTheme() === "dark" ? "light" : "dark";
    retheme();
  });
  preference.addEventListener("change", retheme);

  // Paper is white and has its own width: figures are drawn anew for it. A page opened at #print is for paper from the
  // start, which a program that prints it waits for.
  const forPaper = () => { root.classList.add("printing"); applyTheme("light"); };
  window.addEventListener("beforeprint", () => { forPaper(); drawAll(); });
  window.addEventListener("afterprint", () => { root.classList.remove("printing"); retheme(); });

  if (location.hash === "#print") forPaper(); else applyTheme(wantedTheme());
  drawAll().then(() => { root.dataset.drawn = "yes"; });
})();
