"use strict";

// What the pages share. Everything they show is in the record; nothing is loaded.
// Texts of the record become text nodes, or go through plain() where Plotly would read markup.

const record = JSON.parse(document.getElementById("record").textContent);
const busOf = new Map(record.map.buses.map(bus => [bus.number, bus]));

const INK = "#1b1f24", SOFT = "#535c66", FAINT = "#b4bbc3";
const CONFIG = {displaylogo: false, responsive: true,
  modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"]};
const FONT = {family: "system-ui, Segoe UI, Roboto, Arial, sans-serif", size: 12, color: INK};

// ---- small helpers -------------------------------------------------------------------------------

function element(name, text, options = {}) {
  const made = document.createElement(name);
  if (text !== undefined && text !== null) made.textContent = text;
  for (const [key, value] of Object.entries(options)) made.setAttribute(key, value);
  return made;
}
const at = id => document.getElementById(id);
const say = (id, text) => { at(id).textContent = text; };
const known = value => value !== null && value !== undefined;
const fixed = (value, digits) => known(value) ? value.toFixed(digits) : "";
// Plotly reads entities, then tags: a sign without width after each "&" and "<" makes them neither.
const plain = text => String(text).replace(/[&<]/g, "$&\u2060");
const many = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
// Seconds and degrees without trailing zeros.
const short = (value, digits) => String(Number(value.toFixed(digits)));

function busName(number) {
  const bus = busOf.get(Number(number));
  return bus && bus.name ? `${number} (${bus.name.trim()})` : String(number);
}
function machineName(unit) {
  const bus = busOf.get(Number(unit.split(":")[0]));
  return bus && bus.name ? `${unit} (${bus.name.trim()})` : unit;
}
function draw(id, traces, layout) {
  const base = {font: FONT, paper_bgcolor: "#fff", plot_bgcolor: "#fff", hovermode: "closest",
    hoverlabel: {bgcolor: "#fff", font: FONT, align: "left"}};
  return Plotly.react(at(id), traces, {...base, ...layout}, CONFIG);
}
// Heights in pixels: of a plot's buttons, and of a legend in lines above it.
const BUTTONS = 26;
function legendHeight(labels, width) {
  const entry = 50 + 6.5 * Math.max(...labels.map(label => label.length));
  return 12 + 19 * Math.ceil(labels.length / Math.max(1, Math.floor(width / entry)));
}
const axis = (title, more = {}) => ({title: {text: title, standoff: 6}, gridcolor: "#e8ebee",
  zerolinecolor: "#c9ced4", linecolor: "#848d97", automargin: true, ...more});

function banner(title, items) {
  const box = element("div", null, {class: "banner", role: "note"});
  box.append(element("strong", title));
  if (items.length) box.append(list("ul", items));
  at("banners").append(box);
}
function list(kind, items) {
  const made = element(kind);
  made.append(...items.map(item => element("li", item)));
  return made;
}

function definitions(id, pairs) {
  at(id).replaceChildren(...pairs.map(([term, text]) => {
    const pair = element("div");
    pair.append(element("dt", term), element("dd", text));
    return pair;
  }));
}

// ---- map -----------------------------------------------------------------------------------------

function lines(pairs) {
  const x = [], y = [];
  for (const [from, to] of pairs) {
    const a = busOf.get(from), b = busOf.get(to);
    if (a && b) { x.push(a.x, b.x, null); y.push(a.y, b.y, null); }
  }
  return {x, y};
}
function mapLayout(height) {
  const {geographic, buses} = record.map;
  const middle = buses.reduce((sum, bus) => sum + bus.y, 0) / buses.length;
  const ratio = geographic ? 1 / Math.max(0.2, Math.cos(middle * Math.PI / 180)) : 1;
  const none = {visible: false, fixedrange: false};
  return {height, margin: {l: 4, r: 4, t: 4, b: 4}, dragmode: "pan", uirevision: "map",
    legend: {orientation: "h", x: 0, y: -0.01, yanchor: "top", font: {size: 11}},
    xaxis: none, yaxis: {...none, scaleanchor: "x", scaleratio: ratio}};
}
function mapCaption() {
  const {geographic, buses, branches} = record.map;
  say("map-caption", `${many(buses.length, "bus").replace(/buss$/, "buses")}, ${many(branches.length, "branch").replace(/branchs$/, "branches")}. `
    + (geographic ? "Placed by longitude and latitude." : "The case has no coordinates: buses are placed by an automatic layout, and distances mean nothing."));
  at("map-caption").append(element("span", " Drag to move, double-click to see all.", {class: "screen"}));
}
