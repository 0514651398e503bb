"use strict";

// The report of a study. Everything it shows is in the record; nothing is loaded.
// Texts of the study become text nodes, or go through plain() where Plotly would read markup.

const record = JSON.parse(document.getElementById("record").textContent);
const rows = record.rows.map(values =>
  Object.fromEntries(record.fields.map((field, k) => [field, values[k]])));
const byNumber = new Map(rows.map(row => [row.number, row]));
const busOf = new Map(record.map.buses.map(bus => [bus.number, bus]));

// Okabe & Ito, without the yellow, which is too light for lines; black comes last.
const PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
const SYMBOLS = ["circle", "square", "triangle-up", "diamond", "x", "cross", "star", "triangle-down",
  "hexagon", "triangle-left"];
const INK = "#1b1f24", SOFT = "#535c66", FAINT = "#b4bbc3";
const VERDICTS = {
  stable: {sign: "●", color: "#0072B2", pattern: ""},
  unstable: {sign: "▲", color: "#D55E00", pattern: "/"},
  failed: {sign: "✕", color: "#1b1f24", pattern: "x"},
};
const RUNS = {
  run: {label: record.kind + " run", dash: "solid", css: "", width: 2},
  detailed: {label: "detailed run", dash: "dash", css: "dashed", width: 1.7},
  linear: {label: "linear run", dash: "dot", css: "dotted", width: 1.7},
};
const MODELS = {
  detailed: {color: "#0072B2", pattern: ""},
  hybrid: {color: "#E69F00", pattern: "/"},
  linear: {color: "#999999", pattern: "."},
};
const CONFIG = {displaylogo: false, responsive: true,
  modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"]};
const FONT = {family: "system-ui, Segoe UI, Roboto, Arial, sans-serif", size: 12, color: INK};
// Machines with a colour and a sign of their own; further ones are thin lines.
const TOLD_APART = 10, AT_FIRST = 300, BARS = 150;

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
const verdictOf = row => row.stable === null ? "failed" : row.stable ? "stable" : "unstable";
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
function withSign(parent, verdict, text) {
  parent.append(element("span", VERDICTS[verdict]?.sign ?? "○", {class: "sign", "aria-hidden": "true"}), text);
  return parent;
}
function draw(id, traces, layout) {
  const base = {font: FONT, paper_bgcolor: "#fff", plot_bgcolor: "#fff", hovermode: "closest",
    hoverlabel: {bgcolor: "#fff", font: FONT, align: "left"}};
  return Plotly.react(at(id), traces, {...base, ...layout}, CONFIG);
}
// White lines on the bar's colour.
const hatch = style => ({shape: style.pattern, fillmode: "overlay", fgcolor: "#fff", size: 7, solidity: 0.25});
const axis = (title, more = {}) => ({title: {text: title, standoff: 6}, gridcolor: "#e8ebee",
  zerolinecolor: "#c9ced4", linecolor: "#848d97", automargin: true, ...more});

// ---- header --------------------------------------------------------------------------------------

function header() {
  say("study", record.study);
  say("about", `Case ${record.case}. Model: ${record.model}.`);
  const counts = record.counts;
  const tiles = [["stable", counts.stable], ["unstable", counts.unstable], ["failed", counts.failed]];
  if (counts.waiting) tiles.push(["waiting", counts.waiting]);
  for (const [verdict, count] of tiles) {
    const tile = element("li", null, {class: verdict});
    const label = verdict === "waiting" ? "not run yet" : verdict;
    tile.append(element("b", count));
    at("verdicts").append(withSign(tile, verdict, `${label} of ${counts.total}`));
  }
  say("evidence", evidence());
  banners();
}

function evidence() {
  const accuracy = record.accuracy;
  const tolerance = accuracy.tolerance ? ` Tolerance: ${accuracy.tolerance}.` : "";
  if (record.kind === "detailed") return "Accuracy: all runs are of the detailed model; nothing is reduced.";
  if (!accuracy.checked) {
    return accuracy.asked
      ? "Accuracy: none of the contingencies to be checked against the detailed model has a result yet."
      : "Accuracy: no contingency was checked against the detailed model, so the error is not known." + tolerance;
  }
  const words = [`Accuracy: ${accuracy.checked} of ${many(record.counts.total, "contingency").replace(
    /contingencys$/, "contingencies")} were run again with the detailed model.`];
  words.push(accuracy.other_verdict.length
    ? `The verdict is another one for ${accuracy.other_verdict.join(", ")}.`
    : "The verdict is the same for all of them.");
  if (accuracy.compared) {
    words.push(`RMS error of the rotor angles of the study area, worst machine of each: largest `
      + `${degrees(accuracy.largest_rms_deg)} (${accuracy.worst_name}, machine ${accuracy.worst_machine}), `
      + `median ${degrees(accuracy.median_rms_deg)}`
      + (accuracy.compared < accuracy.checked
        ? `; ${accuracy.checked - accuracy.compared} ended at another time and have no error.` : "."));
  }
  if (accuracy.further) words.push(`Besides: ${accuracy.further}.`);
  return words.join(" ") + tolerance;
}
const degrees = value => value !== 0 && value < 0.01 ? "less than 0.01°" : `${value.toFixed(2)}°`;

function banners() {
  const {validated, replacements, unsupported} = record.warnings;
  if (!validated) {
    banner("Not validated: parts of the data are replaced or left out.",
      [...replacements, ...unsupported]);
  }
  if (record.counts.waiting) {
    banner(`Not finished: ${record.counts.total - record.counts.waiting} of ${record.counts.total} `
      + "contingencies have a result. The study can be resumed.", []);
  }
  if (record.counts.failed && record.counts.failed === rows.length) {
    banner("All contingencies failed; the reasons are in the table.", []);
  }
  if (record.accuracy.beyond_tolerance.length) {
    banner("Runs that were checked err by more than the tolerance.", record.accuracy.beyond_tolerance);
  }
  if (record.accuracy.other_verdict.length) {
    banner("The detailed model gives another verdict for contingencies that were checked.",
      record.accuracy.other_verdict);
  }
}
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

// ---- table ---------------------------------------------------------------------------------------

const COLUMNS = [
  {field: "number", head: "No.", digits: 0, always: true},
  {field: "name", head: "Contingency", text: true, always: true},
  {field: "verdict", head: "Verdict", text: true, always: true},
  {field: "largest_separation_deg", head: "Separation", unit: "deg", digits: 1, help: "largest difference of two rotor angles"},
  {field: "lowest_voltage", head: "Lowest V", unit: "p.u.", digits: 3, help: "of energized buses after the last event"},
  {field: "critical_clearing_time", head: "CCT", unit: "s", digits: decimals("critical_clearing_time", 4), help: "critical clearing time"},
  {field: "error_rms_deg", head: "Error", unit: "deg RMS", digits: 2, help: "of rotor angles, against the detailed run"},
  {field: "damping_ratio", head: "Damping", unit: "%", digits: 1, factor: 100, help: "of the dominant swing of the critical machine"},
  {field: "nadir_hz", head: "Nadir", unit: "Hz", digits: 3, help: "lowest frequency of any island"},
  {field: "islanded_mw", head: "Cut off", unit: "MW", digits: 0, seldom: true, help: "generation outside the largest island at the end"},
  {field: "lost_load_mw", head: "Lost load", unit: "MW", digits: 0, seldom: true, help: "at buses that are de-energized at the end"},
  {field: "critical_machine", head: "Machine", text: true, help: "the critical one: lost synchronism, off speed, or swung furthest"},
];
// Decimals of the figures as they are: clearing times have those of the study's resolution.
function decimals(field, most) {
  return Math.max(0, ...rows.filter(row => known(row[field]))
    .map(row => (short(row[field], most).split(".")[1] ?? "").length));
}
const rank = new Map(rows.map((row, k) => [row.number, k]));
const shown = {verdict: "all", text: "", sort: null, descending: false, limit: AT_FIRST, chosen: null};

// Columns that are empty everywhere are left out, and some that are 0 everywhere.
const columns = COLUMNS.filter(column => column.always
  || rows.some(row => column.seldom ? row[column.field] : known(row[column.field])));
const valueOf = (row, field) => field === "verdict" ? verdictOf(row) : row[field];

function heads() {
  for (const column of columns) {
    const head = element("th", null, {scope: "col", "data-field": column.field});
    if (column.text) head.className = "text";
    const button = element("button", column.head, {type: "button"});
    if (column.help) button.title = column.help;
    if (column.unit) button.append(element("small", column.unit));
    button.addEventListener("click", () => sortBy(column));
    // On paper a browser repeats the head on every page only if there is no button in it.
    const words = element("span", [column.head, column.unit].filter(Boolean).join(", "), {class: "paper"});
    head.append(button, words);
    at("heads").append(head);
  }
}
function sortBy(column) {
  const again = shown.sort === column.field;
  // Figures begin with the worst: the largest, but for voltage, frequency, damping and clearing time.
  const down = ["largest_separation_deg", "error_rms_deg", "islanded_mw", "lost_load_mw"].includes(column.field);
  shown.descending = again ? !shown.descending : down;
  shown.sort = column.field;
  fill();
}
function matching() {
  const words = shown.text.toLowerCase().split(/\s+/).filter(Boolean);
  return rows.filter(row => {
    if (shown.verdict !== "all" && verdictOf(row) !== shown.verdict) return false;
    const text = [row.name, row.kind, row.critical_machine, row.status, row.reason].join(" ").toLowerCase();
    return words.every(word => text.includes(word));
  });
}
function sorted(found) {
  if (!shown.sort) return found;
  const sign = shown.descending ? -1 : 1;
  const compare = (a, b) => typeof a === "string"
    ? a.localeCompare(b, "en", {numeric: true}) : a - b;
  return [...found].sort((one, other) => {
    const a = valueOf(one, shown.sort), b = valueOf(other, shown.sort);
    if (!known(a) || !known(b)) return known(b) - known(a) || rank.get(one.number) - rank.get(other.number);
    return sign * compare(a, b) || rank.get(one.number) - rank.get(other.number);
  });
}
function fill() {
  for (const head of at("heads").children) {
    head.removeAttribute("aria-sort");
    if (head.dataset.field === shown.sort) {
      head.setAttribute("aria-sort", shown.descending ? "descending" : "ascending");
    }
  }
  const found = sorted(matching());
  const visible = found.slice(0, shown.limit);
  at("body").replaceChildren(...visible.map(tableRow));
  say("caption", caption(found.length, visible.length));
  at("more").hidden = visible.length === found.length;
  say("more", `Show all ${found.length}`);
  markRow();
}
function caption(found, visible) {
  if (!rows.length) return "No contingency has a result yet.";
  const order = shown.sort ? "" : " Unstable first, then by the largest separation.";
  const part = visible < found ? `, the first ${visible} shown` : "";
  return `${found} of ${rows.length} contingencies${part}.${order}`;
}
function tableRow(row) {
  const made = element("tr", null, {"data-number": row.number});
  for (const column of columns) made.append(cell(row, column));
  made.addEventListener("click", event => { if (!event.target.closest("a")) choose(row.number); });
  return made;
}
function cell(row, column) {
  const value = valueOf(row, column.field);
  if (column.field === "name") {
    const made = element("th", null, {scope: "row", class: "text"});
    made.append(element("a", value, {href: "#" + row.number}));
    return made;
  }
  if (column.field === "verdict") {
    const made = element("td", null, {class: `text verdict-word ${value}`});
    return withSign(made, value, value);
  }
  if (column.text) return element("td", value ?? "", {class: "text"});
  return element("td", tableFigure(row, column, value));
}
function tableFigure(row, column, value) {
  if (!known(value)) return "";
  const number = value * (column.factor ?? 1);
  const text = number.toFixed(column.digits);
  const beyond = column.field === "critical_clearing_time" && row.clearing_time_bounded === false;
  return (beyond ? "≥ " : "") + text;
}
function chips() {
  const counts = record.counts;
  const all = {all: rows.length, stable: counts.stable, unstable: counts.unstable, failed: counts.failed};
  for (const [verdict, count] of Object.entries(all)) {
    const button = element("button", null, {type: "button", "data-verdict": verdict,
      "aria-pressed": String(verdict === "all"), class: verdict});
    if (verdict === "all") button.append(`all ${count}`);
    else withSign(button, verdict, `${verdict} ${count}`);
    button.addEventListener("click", () => {
      shown.verdict = verdict;
      for (const other of at("chips").children) {
        other.setAttribute("aria-pressed", String(other.dataset.verdict === verdict));
      }
      fill();
    });
    at("chips").append(button);
  }
}
function arrows(event) {
  const step = {ArrowDown: 1, ArrowUp: -1}[event.key];
  const link = event.target.closest?.("tbody a");
  if (!step || !link) return;
  const next = link.closest("tr")[step > 0 ? "nextElementSibling" : "previousElementSibling"];
  if (!next) return;
  event.preventDefault();
  next.querySelector("a").focus();
  choose(Number(next.dataset.number), false);
}

// ---- the selected contingency --------------------------------------------------------------------

function choose(number, show = true) {
  if (location.hash === "#" + number) select(number, show);
  else { showNext = show; location.hash = "#" + number; }
}
let showNext = true;
function fromAddress() {
  const number = Number(location.hash.slice(1));
  if (byNumber.has(number)) select(number, showNext);
  showNext = true;
}
function select(number, show) {
  shown.chosen = number;
  const row = byNumber.get(number), events = record.events[number];
  const title = at("selected-title");
  title.replaceChildren(`No. ${number}: ${row.name} — `);
  const verdict = verdictOf(row), span = element("span", null, {class: verdict});
  title.append(withSign(span, verdict, verdict));
  say("selected-events", events.words.join("; ") + ".");
  say("selected-reason", sentence(row));
  markRow();
  overlays(number);
  drawCurves(number);
  figures(row);
  drawMap(events);
  const narrow = window.matchMedia("(max-width: 900px)").matches;
  if (show && narrow) at("selected").scrollIntoView({block: "start"});
}
function markRow() {
  for (const line of at("body").children) {
    const chosen = Number(line.dataset.number) === shown.chosen;
    line.classList.toggle("chosen", chosen);
    const link = line.querySelector("a");
    if (chosen) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current");
  }
}
function sentence(row) {
  if (row.stable) return `Synchronism is kept until the end of the run at ${short(row.ended_at, 3)} s.`;
  const reason = row.reason || row.status;
  return reason.charAt(0).toUpperCase() + reason.slice(1) + ".";
}

function figures(row) {
  const pairs = [];
  const add = (term, value, text) => { if (known(value)) pairs.push([term, text]); };
  const time = (value, digits = 2) => known(value) ? `, at ${short(value, digits)} s` : "";
  const bus = value => known(value) ? ` at bus ${busName(value)}` : "";
  add("Critical machine", row.critical_machine, () => machineName(row.critical_machine));
  add("Largest swing from the centre of inertia", row.largest_swing_deg, () => `${fixed(row.largest_swing_deg, 1)}°`);
  add("Largest separation", row.largest_separation_deg, () => `${fixed(row.largest_separation_deg, 1)}°${time(row.separation_at)}`);
  add("Lowest voltage after the last event", row.lowest_voltage, () => `${fixed(row.lowest_voltage, 3)} p.u.${bus(row.lowest_voltage_bus)}${time(row.lowest_voltage_at)}`);
  add("Highest voltage after the last event", row.highest_voltage, () => `${fixed(row.highest_voltage, 3)} p.u.${bus(row.highest_voltage_bus)}${time(row.highest_voltage_at)}`);
  add("Lowest frequency", row.nadir_hz, () => `${fixed(row.nadir_hz, 3)} Hz${time(row.nadir_at)}`);
  add("Highest frequency", row.highest_hz, () => `${fixed(row.highest_hz, 3)} Hz`);
  add("Islands at the end", row.islands, () => row.islands !== 1 || row.lost_load_mw
    ? `${row.islands}, ${fixed(row.islanded_mw, 1)} MW of generation outside the largest, ${fixed(row.lost_load_mw, 1)} MW of load lost` : "");
  add("Dominant swing", row.swing_hz, () => `${fixed(row.swing_hz, 2)} Hz`
    + (known(row.damping_ratio) ? `, damping ratio ${fixed(100 * row.damping_ratio, 1)} %` : ""));
  add("Critical clearing time", row.critical_clearing_time, () => clearingWords(row));
  add("Checked with the detailed model", row.checked, () => checkedWords(row));
  add("Rotor-angle error", row.error_rms_deg, () => `${degrees(row.error_rms_deg)} RMS (machine ${row.error_machine}), at most ${degrees(row.error_largest_deg)}`);
  add("Simulated with", row.detailed_s, () => Object.keys(MODELS).filter(model => row[model + "_s"] > 0)
    .map(model => `${model} ${short(row[model + "_s"], 3)} s`).join(", "));
  add("Time on the machine", row.wall_s, () => `${row.wall_s.toPrecision(2)} s`
    + (known(row.wall_check_s) ? `, of that ${row.wall_check_s.toPrecision(2)} s for the check` : ""));
  add("Notices", row.notices, () => noticeWords(row.notices));
  definitions("figures", pairs.map(([term, text]) => [term, text()]).filter(([, text]) => text));
}
function definitions(id, pairs) {
  at(id).replaceChildren(...pairs.map(([term, text]) => {
    const pair = element("div");
    pair.append(element("dt", term), element("dd", text));
    return pair;
  }));
}
function clearingWords(row) {
  const beyond = row.clearing_time_bounded === false ? "at least " : "";
  const margin = known(row.margin)
    ? `, ${short(Math.abs(row.margin), 4)} s ${row.margin < 0 ? "shorter" : "longer"} than the fault lasts` : "";
  const paper = record.paper?.times[row.number];
  return `${beyond}${short(row.critical_clearing_time, 4)} s${margin}`
    + (known(paper) ? `; the paper has ${paper} s` : "");
}
function checkedWords(row) {
  const ended = row.checked.replaceAll("_", " ");
  return ended === row.status ? `same verdict: ${ended}` : `another verdict: ${ended}`;
}
function noticeWords(text) {
  return JSON.parse(text).map(([time, words]) => `${short(time, 4)} s: ${words}`).join("; ");
}

// ---- curves --------------------------------------------------------------------------------------

const wanted = {run: true, detailed: true, linear: false};

function samples(packed) {
  const bytes = Uint8Array.from(atob(packed.content), sign => sign.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Array.from({length: bytes.length / 2}, (_, k) => {
    const value = view.getInt16(2 * k, true);
    return value === -32768 ? null : value * packed.factor;
  });
}
function anglesOf(curves, name) {
  const run = curves.runs[name];
  if (!run) return null;
  const times = record.times[run.times], values = samples(run);
  return {times, machines: curves.units.map((_, k) => values.slice(k * times.length, (k + 1) * times.length))};
}
function overlays(number) {
  const curves = record.curves[number];
  const runs = curves ? Object.keys(curves.runs) : [];
  at("overlays").replaceChildren(...(runs.length < 2 ? [] : runs.map(name => {
    const label = element("label"), box = element("input", null, {type: "checkbox", "data-run": name});
    box.checked = wanted[name];
    box.addEventListener("change", () => { wanted[name] = box.checked; drawCurves(number); });
    label.append(box, " " + RUNS[name].label, element("span", null, {class: "dash " + RUNS[name].css}));
    return label;
  })));
}
function drawCurves(number) {
  const curves = record.curves[number], row = byNumber.get(number);
  drawWatched(number, curves?.watched, row);
  at("curves-figure").hidden = at("models").hidden = !curves;
  if (!curves) {
    say("curves-note", row.stable === null ? "There are no curves: the contingency could not be simulated."
      : record.some_left_out ? `The page has room for the curves of ${Object.keys(record.curves).length} contingencies; the others are in the folder of the study.`
      : "The study was run without curves.");
    return;
  }
  const names = Object.keys(curves.runs);
  const chosen = names.length === 1 ? names : names.filter(name => wanted[name]);
  const runs = Object.fromEntries(names.map(name => [name, anglesOf(curves, name)]));
  const end = runs.run.times.at(-1) ?? 0;
  const last = Math.max(end, ...chosen.map(name => runs[name].times.at(-1) ?? 0));
  const bands = modelBands(curves, end);
  const traces = [...angleTraces(curves, runs, chosen, row), ...bandTraces(bands)];
  if (curves.error) traces.push(errorTrace(curves, runs.run.times));
  draw("curves", traces, curvesLayout(last, number, Boolean(curves.error)));
  at("curves").setAttribute("aria-label", `Rotor angles, active model and error of ${row.name}`);
  say("curves-caption", "Rotor angles of the study area against the centre of inertia, the model in use"
    + (curves.error ? ", and the largest error of a rotor angle against the detailed run." : ".")
    + (record.events[number].faults.length ? " Grey band: the fault is on." : "")
    + (curves.units.length > TOLD_APART ? ` Thin grey: machines beyond the ${TOLD_APART} that swing most.` : ""));
  say("curves-note", curves.error ? "" : row.checked ? "The detailed run ended at another time, so there is no error over time."
    : record.kind === "detailed" ? "" : "This contingency was not in the sample that is checked against the detailed model.");
  at("switches").replaceChildren(...bands.map(band => element("li",
    `${short(band.from, 3)} to ${short(band.to, 3)} s: ${band.model} — ${band.reason}`)));
}
function order(curves, run, row) {
  // The critical machine first, then those that swing most.
  const most = run.machines.map(values => Math.max(...values.map(value => Math.abs(value ?? 0))));
  return curves.units.map((_, k) => k).sort((a, b) =>
    (curves.units[b] === row.critical_machine) - (curves.units[a] === row.critical_machine) || most[b] - most[a]);
}
function angleTraces(curves, runs, chosen, row) {
  const traces = [];
  const places = order(curves, runs.run, row);
  // Those that stand out are drawn last, on top.
  for (const [place, k] of [...places.entries()].reverse()) {
    const unit = curves.units[k], apart = place < TOLD_APART;
    const color = apart ? PALETTE[place % PALETTE.length] : FAINT;
    const critical = unit === row.critical_machine;
    for (const [index, name] of chosen.entries()) {
      const style = RUNS[name], marked = apart && index === 0;
      traces.push({
        type: "scatter", mode: marked ? "lines+markers" : "lines", x: runs[name].times, y: runs[name].machines[k],
        name: plain(unit) + (critical ? " critical" : ""), legendgroup: unit, showlegend: marked, legendrank: place,
        line: {color, dash: style.dash, width: apart ? style.width + (critical ? 1 : 0) : 1},
        marker: {symbol: SYMBOLS[place % SYMBOLS.length], size: 7, color, maxdisplayed: 8},
        hovertemplate: `machine ${plain(machineName(unit))}, ${style.label}<br>%{y:.1f}° at %{x:.2f} s<extra></extra>`,
      });
    }
  }
  return traces;
}
function modelBands(curves, end) {
  if (!curves.switches.length) return [{model: record.kind, from: 0, to: end, reason: "the whole run"}];
  return curves.switches.map(([time, model, reason], k) =>
    ({model, from: time, to: curves.switches[k + 1]?.[0] ?? end, reason}));
}
function bandTraces(bands) {
  const models = [...new Set([...bands.map(band => band.model)])];
  return models.map(model => {
    const own = bands.filter(band => band.model === model);
    const style = MODELS[model] ?? MODELS.detailed;
    return {type: "bar", orientation: "h", yaxis: "y2", showlegend: false, name: model, width: 0.75,
      base: own.map(band => band.from), x: own.map(band => band.to - band.from), y: own.map(() => model),
      marker: {color: style.color, line: {color: style.color, width: 1.5},
        pattern: hatch(style)},
      text: own.map(band => plain(band.reason)), textposition: "none",
      customdata: own.map(band => [band.from, band.to]),
      hovertemplate: `${plain(model)}, %{customdata[0]:.3~f} to %{customdata[1]:.3~f} s<br>%{text}<extra></extra>`};
  });
}
function errorTrace(curves, times) {
  return {type: "scatter", mode: "lines", yaxis: "y3", x: times, y: samples(curves.error), showlegend: false,
    name: "error", line: {color: INK, width: 1.5},
    hovertemplate: "largest error %{y:.2f}° at %{x:.2f} s<extra></extra>"};
}
function curvesLayout(last, number, error) {
  const height = error ? 590 : 480, usable = height - 110;
  // Heights in pixels, from below: error, model, angles.
  const below = error ? 100 / usable : 0, gap = 26 / usable, strip = 66 / usable;
  const start = error ? below + gap : 0;
  const layout = {
    height, margin: {l: 56, r: 10, t: 60, b: 40}, barmode: "overlay",
    legend: {orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: {size: 11}, tracegroupgap: 0},
    xaxis: axis("time (s)", {range: [0, last * 1.005 || 1], anchor: error ? "y3" : "y2"}),
    yaxis: axis("rotor angle (deg)", {domain: [start + strip + gap, 1]}),
    yaxis2: axis("", {domain: [start, start + strip], type: "category", fixedrange: true, showgrid: false,
      categoryorder: "array", categoryarray: ["linear", "hybrid", "detailed"], range: [-0.5, 2.5]}),
    shapes: record.events[number].faults.map(([x0, x1]) => ({type: "rect", yref: "paper", y0: 0, y1: 1,
      x0, x1: Math.min(x1, last), fillcolor: "#8b949e", opacity: 0.25, line: {width: 0}, layer: "below"})),
  };
  if (error) layout.yaxis3 = axis("error (deg)", {domain: [0, below], rangemode: "tozero", nticks: 4});
  if (!["detailed", "hybrid", "linear", "adaptive", "whole"].includes(record.kind)) {
    layout.yaxis2 = {...layout.yaxis2, categoryarray: undefined, range: undefined};
  }
  return layout;
}

// ---- what is watched -----------------------------------------------------------------------------

const PANEL = 190, BETWEEN = 46;

function drawWatched(number, watched, row) {
  at("watched-figure").hidden = !watched;
  if (!watched) return;
  const times = record.times[watched.times], count = watched.panels.length;
  const traces = watched.panels.flatMap((panel, k) => panelTraces(panel, k, times));
  draw("watched", traces, watchedLayout(watched.panels, times, number, count));
  at("watched").setAttribute("aria-label", `What was watched of ${row.name}`);
  say("watched-caption", `Watched: ${watched.panels.map(panel => panel.axis).join(", ")}.`
    + (watched.left_out ? ` ${watched.left_out} curves that move less are left out.` : ""));
}
function panelTraces(panel, k, times) {
  const values = samples(panel), suffix = k ? k + 1 : "";
  return panel.labels.map((label, place) => ({
    type: "scatter", mode: "lines", x: times, y: values.slice(place * times.length, (place + 1) * times.length),
    yaxis: `y${suffix}`, legend: `legend${suffix}`, name: plain(label),
    line: {color: PALETTE[place % PALETTE.length], width: 1.5, dash: place < PALETTE.length ? "solid" : "dot"},
    hovertemplate: `${plain(label)}<br>%{y:.5~g} at %{x:.2f} s<extra></extra>`,
  }));
}
function watchedLayout(panels, times, number, count) {
  const usable = count * PANEL + (count - 1) * BETWEEN, last = times.at(-1) ?? 0;
  const layout = {height: usable + 100, margin: {l: 64, r: 10, t: 50, b: 50}};
  for (const [k, panel] of panels.entries()) {
    const suffix = k ? k + 1 : "", top = 1 - k * (PANEL + BETWEEN) / usable;
    layout[`yaxis${suffix}`] = axis(plain(panel.axis), {domain: [Math.max(0, top - PANEL / usable), top]});
    layout[`legend${suffix}`] = {orientation: "h", x: 0, y: top, yanchor: "bottom", font: {size: 11}};
  }
  layout.xaxis = axis("time (s)", {range: [0, last * 1.005 || 1], anchor: `y${count > 1 ? count : ""}`});
  layout.shapes = record.events[number].faults.map(([x0, x1]) => ({type: "rect", yref: "paper", y0: 0, y1: 1,
    x0, x1: Math.min(x1, last), fillcolor: "#8b949e", opacity: 0.25, line: {width: 0}, layer: "below"}));
  return layout;
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
function branchTrace(name, pairs, line, rank) {
  return {type: "scatter", mode: "lines", name, ...lines(pairs), line, hoverinfo: "skip",
    legendrank: rank, visible: pairs.length ? true : false};
}
function busTrace(name, buses, marker, rank) {
  return {type: "scatter", mode: "markers", name, x: buses.map(bus => bus.x), y: buses.map(bus => bus.y),
    marker, legendrank: rank, text: buses.map(bus => plain(busName(bus.number))),
    hovertemplate: `bus %{text}<br>${name}<extra></extra>`, visible: buses.length ? true : false};
}
function gridTraces() {
  const {buses, branches, kept} = record.map;
  const study = number => Boolean(busOf.get(number)?.study);
  const inside = branches.filter(([a, b]) => study(a) && study(b));
  const ties = branches.filter(([a, b]) => study(a) !== study(b));
  const outside = branches.filter(([a, b]) => !study(a) && !study(b));
  const nonlinear = buses.filter(bus => kept.includes(bus.number) && !bus.study);
  const rest = buses.filter(bus => !bus.study && !nonlinear.includes(bus));
  const area = buses.some(bus => bus.study);
  return [
    branchTrace("", outside, {color: "#c3c9d0", width: 1}, 9),
    branchTrace("", inside, {color: "#0072B2", width: 1.3}, 9),
    branchTrace("tie line", ties, {color: "#000000", width: 2.6, dash: "dash"}, 4),
    busTrace(area ? "other bus" : "bus", rest.filter(bus => !bus.machine),
      {color: "#fff", size: 4.5, line: {color: "#848d97", width: 1}}, 8),
    busTrace(area ? "other machine" : "machine", rest.filter(bus => bus.machine),
      {color: "#848d97", size: 7, symbol: "square"}, 7),
    busTrace("study area", buses.filter(bus => bus.study && !bus.machine), {color: "#0072B2", size: 6}, 2),
    busTrace("machine of the study area", buses.filter(bus => bus.study && bus.machine),
      {color: "#0072B2", size: 9, symbol: "square"}, 3),
    busTrace("machine kept nonlinear", nonlinear,
      {color: "#E69F00", size: 11, symbol: "diamond", line: {color: "#000", width: 1}}, 5),
  ].map(trace => trace.name ? trace : {...trace, showlegend: false});
}
function faultSpots(events) {
  const spots = events.buses.map(number => busOf.get(number)).filter(Boolean)
    .map(bus => ({x: bus.x, y: bus.y, text: "bus " + busName(bus.number)}));
  for (const [from, to, fraction] of events.branches) {
    const a = busOf.get(from), b = busOf.get(to);
    if (!a || !b) continue;
    const share = fraction ?? 0.5;
    spots.push({x: a.x + share * (b.x - a.x), y: a.y + share * (b.y - a.y), text: `branch ${from}-${to}`});
  }
  return spots;
}
function faultTraces(events, spots) {
  return [
    {...branchTrace("", events.branches, {color: "#D55E00", width: 5}, 9), showlegend: false},
    {type: "scatter", mode: "markers", name: "selected contingency", legendrank: 1, visible: spots.length > 0,
      x: spots.map(spot => spot.x), y: spots.map(spot => spot.y), text: spots.map(spot => plain(spot.text)),
      marker: {symbol: "x", size: 15, color: "#D55E00", line: {color: "#fff", width: 1.5}},
      hovertemplate: "%{text}<br>selected contingency<extra></extra>"},
  ];
}
function drawMap(events) {
  const {geographic, buses} = record.map;
  if (!buses.length) { at("map-section").hidden = true; return; }
  const middle = buses.reduce((sum, bus) => sum + bus.y, 0) / buses.length;
  const ratio = geographic ? 1 / Math.max(0.2, Math.cos(middle * Math.PI / 180)) : 1;
  const none = {visible: false, fixedrange: false};
  const spots = faultSpots(events);
  const labels = spots.slice(0, 3).map(spot => ({x: spot.x, y: spot.y, text: `<b>${plain(spot.text)}</b>`,
    showarrow: true, arrowhead: 0, arrowcolor: INK, ax: 0, ay: -46, bgcolor: "rgba(255,255,255,0.88)"}));
  draw("map", [...gridTraces(), ...faultTraces(events, spots)], {annotations: labels,
    height: 470, margin: {l: 4, r: 4, t: 4, b: 4}, dragmode: "pan", uirevision: "map",
    legend: {orientation: "h", x: 0, y: -0.01, yanchor: "top", font: {size: 11}},
    xaxis: none, yaxis: {...none, scaleanchor: "x", scaleratio: ratio},
  });
}
function mapCaption() {
  const {geographic, buses, branches} = record.map;
  say("map-caption", `${many(buses.length, "bus").replace(/buss$/, "buses")}, ${many(branches.length, "branch").replace(/branchs$/, "branches")}. `
    + (geographic ? "Placed by longitude and latitude." : "The case has no coordinates: buses are placed by an automatic layout, and distances mean nothing.")
);
  at("map-caption").append(element("span", " Drag to move, double-click to see all.", {class: "screen"}));
}

// ---- clearing times, distributions ---------------------------------------------------------------

function clearing() {
  const all = rows.filter(row => known(row.critical_clearing_time))
    .sort((a, b) => a.critical_clearing_time - b.critical_clearing_time || a.number - b.number);
  if (!all.length) return;
  at("clearing-section").hidden = false;
  const bars = all.slice(0, BARS), names = bars.map(row => row.number);
  const paper = record.paper?.times ?? {};
  const beside = bars.filter(row => known(paper[row.number]));
  say("clearing-words", clearingSummary(all, bars, all.filter(row => known(paper[row.number]))));
  at("clearing").style.minWidth = `${Math.max(320, 14 * bars.length + 70)}px`;
  const traces = [barTrace("clearing time", bars.filter(row => row.margin >= 0 || !known(row.margin)), VERDICTS.stable),
    barTrace("shorter than the fault: unstable", bars.filter(row => row.margin < 0), VERDICTS.unstable)];
  traces.push({type: "scatter", mode: "markers", name: "paper, Table I", visible: beside.length > 0,
    x: beside.map(row => row.number), y: beside.map(row => paper[row.number]),
    marker: {symbol: "diamond", size: 9, color: "#fff", line: {color: "#000", width: 1.6}},
    hovertemplate: "paper: %{y:.3~f} s<extra></extra>"});
  draw("clearing", traces, {
    height: 340, margin: {l: 54, r: 10, t: 34, b: 10}, bargap: 0.25, barmode: "overlay",
    legend: {orientation: "h", x: 0, y: 1.02, yanchor: "bottom"},
    xaxis: axis("", {type: "category", categoryorder: "array", categoryarray: names, tickmode: "array",
      tickvals: names, ticktext: bars.map(row => plain(row.name)), tickangle: -90, tickfont: {size: 10}, showgrid: false}),
    yaxis: axis("clearing time (s)", {rangemode: "tozero"}),
  });
  at("clearing").on("plotly_click", event => choose(Number(event.points[0].x)));
}
function barTrace(name, bars, style) {
  return {type: "bar", name, x: bars.map(row => row.number), y: bars.map(row => row.critical_clearing_time),
    visible: bars.length > 0, marker: {color: style.color, pattern: hatch(style)},
    text: bars.map(row => plain(row.name)), textposition: "none",
    customdata: bars.map(row => row.clearing_time_bounded === false ? "at least " : ""),
    hovertemplate: "%{text}<br>%{customdata}%{y:.3~f} s<extra></extra>"};
}
function clearingSummary(all, bars, beside) {
  const words = [`${all.length} faults, the shortest clearing time first.`];
  if (bars.length < all.length) words.push(`The ${bars.length} shortest are drawn.`);
  const open = all.filter(row => row.clearing_time_bounded === false).length;
  if (open) words.push(`${open} would be longer than the longest tried.`);
  if (beside.length) {
    const apart = beside.map(row => Math.abs(row.critical_clearing_time - record.paper.times[row.number]));
    const same = apart.filter(value => value < 0.0005).length;
    words.push(`${beside.length} of the faults are those of ${record.paper.source}: ${same} have the same time, `
      + `the others are at most ${short(Math.max(...apart), 3)} s apart.`);
  }
  return words.join(" ");
}
function spreads() {
  const kinds = [
    {field: "lowest_voltage", title: "lowest voltage (p.u.)", factor: 1, words: "Lowest voltage after the last event"},
    {field: "damping_ratio", title: "damping ratio (%)", factor: 100, words: "Damping of the dominant swing"},
  ];
  const enough = kinds.map(kind => ({...kind, found: rows.filter(row => known(row[kind.field]))}))
    .filter(kind => kind.found.length >= 5);
  at("spread-section").hidden = !enough.length;
  for (const {field, words, found} of enough) {
    const figure = element("figure"), plot = element("div", null, {id: "spread-" + field, class: "plot",
      role: "img", "aria-label": words});
    figure.append(element("figcaption", `${words}: ${found.length} contingencies`), plot);
    at("spreads").append(figure);
  }
  // Drawn when all are in their places: only then is their width known.
  for (const kind of enough) drawSpread("spread-" + kind.field, kind, kind.found);
}
function drawSpread(id, kind, found) {
  const values = found.map(row => kind.factor * row[kind.field]);
  const first = Math.min(...values), last = Math.max(...values), size = (last - first) / 20 || 1;
  const traces = ["stable", "unstable"].map(verdict => {
    const own = found.filter(row => verdictOf(row) === verdict);
    const style = VERDICTS[verdict];
    return {type: "histogram", name: verdict, x: own.map(row => kind.factor * row[kind.field]),
      xbins: {start: first, end: last + size, size}, visible: own.length > 0,
      marker: {color: style.color, line: {color: "#fff", width: 1},
        pattern: hatch(style)},
      hovertemplate: `${verdict}: %{y}<br>%{x}<extra></extra>`};
  });
  draw(id, traces, {height: 220, margin: {l: 48, r: 10, t: 24, b: 44}, barmode: "stack", showlegend: true,
    legend: {orientation: "h", x: 1, xanchor: "right", y: 1.02, yanchor: "bottom"},
    xaxis: axis(kind.title, {showgrid: false}), yaxis: axis("contingencies", {nticks: 4})});
}

// ---- provenance, printing, start -----------------------------------------------------------------

function provenance() {
  const ended = record.finished ? [] : [["State", "not finished"]];
  definitions("origin", [...ended, ...record.provenance]);
  say("study-file", record.study_file);
  if (record.warnings.others.length) {
    at("warnings").append(element("h3", "Warnings of the model"), list("ul", record.warnings.others));
  }
}
// In print every figure has the width of the paper, and what is folded is open.
let unfolded = [];
function beforePrint() {
  unfolded = [...document.querySelectorAll("details:not([open])")];
  for (const folded of unfolded) folded.open = true;
  for (const plot of document.querySelectorAll(".js-plotly-plot")) {
    plot.style.minWidth = "0";
    Plotly.relayout(plot, {width: plot.closest(".pair") ? 325 : 670});
  }
}
function afterPrint() {
  for (const folded of unfolded) folded.open = false;
  for (const plot of document.querySelectorAll(".js-plotly-plot")) {
    Plotly.relayout(plot, {width: null, autosize: true});
  }
}
function start() {
  header();
  heads();
  chips();
  fill();
  mapCaption();
  provenance();
  clearing();
  spreads();
  at("filter").addEventListener("input", event => { shown.text = event.target.value; fill(); });
  at("more").addEventListener("click", () => { shown.limit = Infinity; fill(); });
  at("table").addEventListener("keydown", arrows);
  document.querySelector(".skip").addEventListener("click", event => {
    event.preventDefault();
    at("ranking").focus();
  });
  window.addEventListener("hashchange", fromAddress);
  window.addEventListener("beforeprint", beforePrint);
  window.addEventListener("afterprint", afterPrint);
  const asked = Number(location.hash.slice(1));
  if (byNumber.has(asked)) select(asked, false);
  else if (rows.length) select(rows[0].number, false);
  else {
    drawMap({buses: [], branches: []});
    at("selected").hidden = true;
  }
}
start();
