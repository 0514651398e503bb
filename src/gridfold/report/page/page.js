// The report of a study.

const rows = record.rows.map(values =>
  Object.fromEntries(record.fields.map((field, k) => [field, values[k]])));
const byNumber = new Map(rows.map(row => [row.number, row]));

// Okabe & Ito, without the yellow, which is too light for lines; black comes last.
const PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
const SYMBOLS = ["circle", "square", "triangle-up", "diamond", "x", "cross", "star", "triangle-down",
  "hexagon", "triangle-left"];
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
// From the most exact one down.
const MODELS = {
  detailed: {color: "#0072B2", pattern: ""},
  retained: {color: "#E69F00", pattern: "/"},
  hybrid: {color: "#E69F00", pattern: "/"},
  linear: {color: "#999999", pattern: "."},
  "linear whole": {color: "#CCCCCC", pattern: "\\"},
};
// Machines with a colour and a sign of their own; further ones are thin lines.
const TOLD_APART = 10, BARS = 150;
// Rows beyond both ends of what is seen of the table that are in the page too.
const AHEAD = 8;
const VIOLATING = {sign: "◆", word: "violates criteria"};

const violates = row => Boolean(row.violated);
const verdictOf = row => row.stable === null ? "failed" : row.stable ? "stable" : "unstable";
function withSign(parent, verdict, text) {
  const sign = verdict === "violating" ? VIOLATING.sign : VERDICTS[verdict]?.sign ?? "○";
  parent.append(element("span", sign, {class: "sign", "aria-hidden": "true"}), text);
  return parent;
}
// White lines on the bar's colour.
const hatch = style => ({shape: style.pattern, fillmode: "overlay", fgcolor: "#fff", size: 7, solidity: 0.25});

// ---- header --------------------------------------------------------------------------------------

function header() {
  say("study", record.study);
  say("about", `Case ${record.case}. Model: ${record.model}.`);
  const counts = record.counts;
  const tiles = [["stable", counts.stable], ["unstable", counts.unstable], ["failed", counts.failed]];
  if (counts.waiting) tiles.push(["waiting", counts.waiting]);
  if (known(counts.violating)) tiles.push(["violating", counts.violating]);
  for (const [verdict, count] of tiles) {
    const tile = element("li", null, {class: verdict});
    const label = {waiting: "not run yet", violating: VIOLATING.word.replace("violates", "violate")}[verdict] ?? verdict;
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
  if (accuracy.further) words.push(`Besides: ${accuracy.further.replace(/\.$/, "")}.`);
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
  if (record.accuracy.other_criteria.length) {
    banner("The detailed model violates other criteria for contingencies that were checked.",
      record.accuracy.other_criteria);
  }
  if (record.accuracy.other_verdict.length) {
    banner("The detailed model gives another verdict for contingencies that were checked.",
      record.accuracy.other_verdict);
  }
}
// ---- table ---------------------------------------------------------------------------------------

const COLUMNS = [
  {field: "number", head: "No.", digits: 0, always: true},
  {field: "name", head: "Contingency", text: true, always: true},
  {field: "verdict", head: "Verdict", text: true, always: true},
  {field: "violations", head: "Violates", text: true, help: "numbers of the criteria that are violated; the verdict is about synchronism alone"},
  {field: "largest_separation_deg", head: "Separation", unit: "deg", digits: 1, help: "largest difference of two rotor angles"},
  {field: "lowest_voltage", head: "Lowest V", unit: "p.u.", digits: 3, help: "of energized buses after the last event"},
  {field: "critical_clearing_time", head: "CCT", unit: "s", digits: decimals("critical_clearing_time", 4), help: "critical clearing time"},
  {field: "error_rms_deg", head: "Error", unit: "deg RMS", digits: 2, help: "of rotor angles, against the detailed run"},
  {field: "damping_ratio", head: "Damping", unit: "%", digits: 1, factor: 100, help: "of the dominant swing of the critical machine"},
  {field: "nadir_hz", head: "Nadir", unit: "Hz", digits: 3, help: "lowest frequency of any island, of runs that were completed"},
  {field: "islanded_mw", head: "Cut off", unit: "MW", digits: 0, seldom: true, help: "generation outside the largest island at the end"},
  {field: "lost_load_mw", head: "Lost load", unit: "MW", digits: 0, seldom: true, help: "at buses that are de-energized at the end"},
  {field: "critical_machine", head: "Machine", text: true, help: "the critical one: lost synchronism, off speed, or went furthest from its angle at the start"},
];
// Decimals of the figures as they are: clearing times have those of the study's resolution.
function decimals(field, most) {
  return Math.max(0, ...rows.filter(row => known(row[field]))
    .map(row => (short(row[field], most).split(".")[1] ?? "").length));
}
const rank = new Map(rows.map((row, k) => [row.number, k]));
const shown = {verdict: "all", text: "", sort: null, descending: false, chosen: null,
  found: [], first: 0, last: 0, all: false};

// Columns that are empty everywhere are left out, and some that are 0 everywhere.
const columns = COLUMNS.filter(column => column.always
  || rows.some(row => column.seldom ? row[column.field] : known(row[column.field])));
const valueOf = (row, field) => field === "verdict" ? verdictOf(row) : row[field];
// Numbers of the criteria that a row violates, from 1.
const violatedBy = row => (row.violated || "").split("; ").filter(Boolean)
  .map(name => record.criteria.names.indexOf(name) + 1);

// Widths are those of the longest text of all rows: they stay while the rows in the page change.
function textOf(row, column) {
  const value = valueOf(row, column.field);
  if (column.field === "violations") return "◆ " + violatedBy(row).join(", ");
  return column.text ? String(value ?? "") : tableFigure(row, column, value);
}
function longest(column) {
  const head = [column.head, column.unit ?? ""].map(text => text.length + 0.6);
  return rows.reduce((most, row) => Math.max(most, textOf(row, column).length), Math.max(...head));
}
function widths() {
  const group = element("colgroup");
  let taken = 0;
  for (const column of columns) {
    const made = element("col"), most = longest(column);
    // Letters are narrower than the digits that "ch" is made for.
    const width = column.field === "verdict" ? 10 : 0.92 * most + 0.5;
    if (column.field !== "name") { made.style.width = `calc(${width}ch + .54rem)`; taken += width + 1.2; }
    group.append(made);
  }
  at("table").prepend(group);
  at("table").style.minWidth = `calc(${taken}ch + 7rem)`;
}
// Lines of every row: those that the longest name takes, up to three.
const LETTER = 7;
function rowLines() {
  const name = columns.find(column => column.field === "name");
  const room = at("heads").querySelector("[data-field=name]").clientWidth - 8;
  const needed = Math.ceil(LETTER * longest(name) / Math.max(room, 1));
  at("table").style.setProperty("--lines", Math.min(3, Math.max(1, needed)));
}
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
  // Figures begin with the worst: the largest, but for voltage, frequency, damping, margin and clearing time.
  const down = ["violations", "largest_separation_deg", "error_rms_deg", "islanded_mw", "lost_load_mw"].includes(column.field);
  shown.descending = again ? !shown.descending : down;
  shown.sort = column.field;
  fill();
}
function matching() {
  const words = shown.text.toLowerCase().split(/\s+/).filter(Boolean);
  return rows.filter(row => {
    if (!isShown(row, shown.verdict)) return false;
    const text = [row.name, row.kind, row.critical_machine, row.status, row.reason, row.violated].join(" ").toLowerCase();
    return words.every(word => text.includes(word));
  });
}
// Whether a chip shows a row: all, a verdict, those that violate criteria, or the criterion of a number.
function isShown(row, chip) {
  if (chip === "all") return true;
  if (chip === "violating") return violates(row);
  return Number(chip) ? violatedBy(row).includes(Number(chip)) : verdictOf(row) === chip;
}
function sorted(found) {
  if (!shown.sort) return found;
  const sign = shown.descending ? -1 : 1;
  const order = new Intl.Collator("en", {numeric: true});
  const compare = (a, b) => typeof a === "string" ? order.compare(a, b) : a - b;
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
  shown.found = sorted(matching());
  at("table").setAttribute("aria-rowcount", shown.found.length + 1);
  at("scroll").scrollTop = 0;
  say("caption", caption(shown.found.length));
  drawRows(true);
}
// Only rows that are seen are in the page: every row has the height of the first one.
function rowHeight() {
  const row = at("body").querySelector("tr[data-number]");
  return row?.getBoundingClientRect().height || 24;
}
function drawRows(anew = false) {
  const box = at("scroll"), height = rowHeight(), count = shown.found.length;
  const top = Math.floor(box.scrollTop / height), seen = Math.ceil(box.clientHeight / height);
  const first = shown.all ? 0 : Math.max(0, Math.min(top, count - seen) - AHEAD);
  const last = shown.all ? count : Math.min(count, top + seen + AHEAD);
  if (!anew && first === shown.first && last === shown.last) return;
  shown.first = first;
  shown.last = last;
  const made = shown.found.slice(first, last).map((row, k) => tableRow(row, first + k));
  at("body").replaceChildren(...spacer(first * height), ...made, ...spacer((count - last) * height));
  // The height is known for sure only once a row is there.
  if (made.length && Math.abs(rowHeight() - height) > 0.01) drawRows(true);
  markRow();
}
function spacer(height) {
  if (height <= 0) return [];
  const made = element("tr", null, {class: "spacer", "aria-hidden": "true"});
  made.style.height = `${height}px`;
  return [made];
}
// Scroll until a contingency is seen, if the table has it.
function reveal(number) {
  const place = shown.found.findIndex(row => row.number === number);
  if (place < 0) return;
  const box = at("scroll"), height = rowHeight(), head = at("heads").getBoundingClientRect().height;
  if (place * height < box.scrollTop) box.scrollTop = place * height;
  else if ((place + 1) * height + head > box.scrollTop + box.clientHeight) {
    box.scrollTop = (place + 1) * height + head - box.clientHeight;
  }
  drawRows();
}
function caption(found) {
  if (!rows.length) return "No contingency has a result yet.";
  const then = record.criteria ? "then those that violate criteria, then by" : "then by";
  const order = shown.sort ? "" : ` Unstable first, ${then} the largest separation.`;
  return `${found} of ${rows.length} contingencies.${order}`;
}
function tableRow(row, place) {
  const made = element("tr", null, {"data-number": row.number, "aria-rowindex": place + 2});
  for (const column of columns) made.append(cell(row, column));
  made.addEventListener("click", event => { if (!event.target.closest("a")) choose(row.number); });
  return made;
}
function cell(row, column) {
  const value = valueOf(row, column.field);
  if (column.field === "name") {
    const made = element("th", null, {scope: "row", class: "text", title: value});
    const link = element("a", value, {href: "#" + row.number, class: "lines"});
    made.append(link);
    return made;
  }
  if (column.field === "verdict") {
    const made = element("td", null, {class: `text verdict-word ${value}`});
    return withSign(made, value, value);
  }
  if (column.field === "violations") return violatedCell(row);
  if (column.text) return element("td", value ?? "", {class: "text"});
  return element("td", tableFigure(row, column, value));
}
function violatedCell(row) {
  if (violates(row)) {
    const made = element("td", null, {class: "text violating", title: row.violated});
    return withSign(made, "violating", violatedBy(row).join(", "));
  }
  return element("td", row.not_judged ? "○" : "", {class: "text soft", title: row.not_judged ? `not judged: ${row.not_judged}` : ""});
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
  if (known(counts.violating)) all.violating = counts.violating;
  for (const [verdict, count] of Object.entries(all)) {
    const words = verdict === "all" ? `all ${count}` : `${verdict === "violating" ? "violate criteria" : verdict} ${count}`;
    chip("chips", verdict, words);
  }
  at("criteria-chips").hidden = !record.criteria;
  for (const [k, name] of (record.criteria?.names ?? []).entries()) {
    const count = rows.filter(row => violatedBy(row).includes(k + 1)).length;
    chip("criteria-chips", String(k + 1), `${k + 1} ${name}: ${count}`);
  }
}
function chip(group, verdict, words) {
  const button = element("button", null, {type: "button", "data-verdict": verdict,
    "aria-pressed": String(verdict === "all"), class: verdict});
  if (VERDICTS[verdict] || verdict === "violating") withSign(button, verdict, words);
  else button.append(words);
  button.addEventListener("click", () => {
    shown.verdict = verdict;
    for (const other of document.querySelectorAll(".chips button")) {
      other.setAttribute("aria-pressed", String(other.dataset.verdict === verdict));
    }
    fill();
  });
  at(group).append(button);
}
function arrows(event) {
  const step = {ArrowDown: 1, ArrowUp: -1}[event.key];
  const link = event.target.closest?.("tbody a");
  if (!step || !link) return;
  const now = shown.found.findIndex(row => row.number === Number(link.closest("tr").dataset.number));
  const next = shown.found[now + step];
  if (!next) return;
  event.preventDefault();
  reveal(next.number);
  at("body").querySelector(`tr[data-number="${next.number}"] a`).focus();
  choose(next.number, false);
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
  if (violates(row)) title.append(", ", withSign(element("span", null, {class: "violating"}), "violating", VIOLATING.word));
  say("selected-events", events.words.join("; ") + ".");
  say("selected-reason", sentence(row));
  reveal(number);
  markRow();
  criteria(row);
  overlays(number);
  drawCurves(number);
  timeline(row);
  figures(row);
  drawMap(events);
  const narrow = window.matchMedia("(max-width: 900px)").matches;
  if (show && narrow) at("selected").scrollIntoView({block: "start"});
}
function markRow() {
  for (const line of at("body").querySelectorAll("tr[data-number]")) {
    const chosen = Number(line.dataset.number) === shown.chosen;
    line.classList.toggle("chosen", chosen);
    const link = line.querySelector("a");
    if (chosen) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current");
  }
}
function sentence(row) {
  return [verdictSentence(row), criteriaSentence(row)].filter(Boolean).join(" ");
}
function verdictSentence(row) {
  if (row.stable) return `Synchronism is kept until the end of the run at ${short(row.ended_at, 3)} s.`;
  const reason = row.reason || row.status;
  const words = [reason.charAt(0).toUpperCase() + reason.slice(1) + "."];
  if (row.status === "lost synchronism" && known(row.largest_angle_deg)) {
    words.push(`It was ${fixed(Math.abs(row.largest_angle_deg), 1)}° from the centre of inertia of its island then; the limit is ${short(record.angle_limit_deg, 1)}°.`);
  }
  if (record.curves[row.number]?.outside.includes(row.critical_machine)) words.push("It lies outside the study area.");
  return words.join(" ");
}
function findings(row) {
  const found = record.criteria?.found[row.number];
  if (!found) return [];
  return found.map(([verdict, margin, unit, time, told, notes], k) =>
    ({name: record.criteria.names[k], verdict, margin, unit, time, told, notes}));
}
function criteriaSentence(row) {
  const all = findings(row);
  if (!all.length) return "";
  const violated = all.filter(item => item.verdict === "violated");
  const open = all.filter(item => item.verdict === "not judged").length;
  const near = [row.close, record.criteria.close[row.number]].filter(Boolean).join("; ");
  const words = [violated.length
    ? `The run violates ${violated.length} of ${many(all.length, "criterion").replace(/criterions$/, "criteria")}: ${violated.map(item => item.name).join("; ")}.`
    : `None of ${many(all.length, "criterion").replace(/criterions$/, "criteria")} is violated.`];
  if (open) words.push(`${open} could not be judged.`);
  if (near) words.push(`The error of the reduced model could turn: ${near}.`);
  return words.join(" ");
}
const KEPT = {kept: "✓", violated: VIOLATING.sign, "not judged": "○"};
function criteria(row) {
  const all = findings(row);
  at("criteria").hidden = !all.length;
  at("criteria-body").replaceChildren(...all.map(item => {
    const made = element("tr", null, {class: item.verdict === "violated" ? "violating" : ""});
    const verdict = element("td", null, {class: "text verdict-word"});
    verdict.append(element("span", KEPT[item.verdict], {class: "sign", "aria-hidden": "true"}), item.verdict);
    const margin = known(item.margin) ? `${item.margin > 0 ? "+" : ""}${Number(item.margin.toPrecision(3))} ${item.unit}` : "";
    made.append(element("th", item.name, {scope: "row", class: "text"}), verdict, element("td", margin),
      element("td", [item.told, ...item.notes].join("; "), {class: "text"}));
    return made;
  }));
}
// What happened, in order of time.
function timeline(row) {
  const marks = row.notices ? JSON.parse(row.notices).map(([time, words]) => [time, words]) : [];
  const mark = (time, words) => { if (known(time)) marks.push([time, words]); };
  if (known(row.largest_separation_deg)) mark(row.separation_at, `largest separation of two rotor angles, ${fixed(row.largest_separation_deg, 1)}°`);
  if (known(row.lowest_voltage)) mark(row.lowest_voltage_at, `lowest voltage after the last event, ${fixed(row.lowest_voltage, 3)} p.u. at bus ${busName(row.lowest_voltage_bus)}`);
  if (known(row.nadir_hz)) mark(row.nadir_at, `lowest frequency, ${fixed(row.nadir_hz, 3)} Hz`);
  for (const item of findings(row)) if (item.verdict === "violated") mark(item.time, `violated: ${item.name}`);
  mark(row.ended_at, row.stable ? "end of the run" : row.reason ?? row.status);
  marks.sort((a, b) => a[0] - b[0]);
  at("timeline-part").hidden = !marks.length;
  at("timeline").replaceChildren(...marks.map(([time, words]) => {
    const line = element("li");
    line.append(element("b", `${short(time, 4)} s`), " ", words);
    return line;
  }));
}

function figures(row) {
  const pairs = [];
  const add = (term, value, text) => { if (known(value)) pairs.push([term, text]); };
  const time = (value, digits = 2) => known(value) ? `, at ${short(value, digits)} s` : "";
  const bus = value => known(value) ? ` at bus ${busName(value)}` : "";
  add("Critical machine", row.critical_machine, () => machineName(row.critical_machine));
  add("Its largest angle from the centre of inertia", row.largest_angle_deg, () => `${fixed(row.largest_angle_deg, 1)}°`);
  add("Largest change of that angle since the start", row.largest_angle_change_deg, () => `${fixed(row.largest_angle_change_deg, 1)}°`);
  add("Largest separation of two rotor angles", row.largest_separation_deg, () => `${fixed(row.largest_separation_deg, 1)}°${time(row.separation_at)}`);
  add("Lowest voltage after the last event", row.lowest_voltage, () => `${fixed(row.lowest_voltage, 3)} p.u.${bus(row.lowest_voltage_bus)}${time(row.lowest_voltage_at)}`);
  add("Highest voltage after the last event", row.highest_voltage, () => `${fixed(row.highest_voltage, 3)} p.u.${bus(row.highest_voltage_bus)}${time(row.highest_voltage_at)}`);
  add("Lowest frequency of an island", row.nadir_hz, () => `${fixed(row.nadir_hz, 3)} Hz${time(row.nadir_at)}`);
  add("Highest frequency of an island", row.highest_hz, () => `${fixed(row.highest_hz, 3)} Hz`);
  add("Islands at the end", row.islands, () => row.islands !== 1 || row.lost_load_mw
    ? `${row.islands}, ${fixed(row.islanded_mw, 1)} MW of generation outside the largest, ${fixed(row.lost_load_mw, 1)} MW of load lost` : "");
  add("Dominant swing", row.swing_hz, () => `${fixed(row.swing_hz, 2)} Hz`
    + (known(row.damping_ratio) ? `, damping ratio ${fixed(100 * row.damping_ratio, 1)} %` : ""));
  add("Critical clearing time", row.critical_clearing_time, () => clearingWords(row));
  add("Checked with the detailed model", row.checked, () => checkedWords(row));
  add("Rotor-angle error", row.error_rms_deg, () => `${degrees(row.error_rms_deg)} RMS (machine ${row.error_machine}), at most ${degrees(row.error_largest_deg)}`);
  add("Simulated with", row.detailed_s, () => Object.keys(MODELS).filter(model => secondsWith(row, model) > 0)
    .map(model => `${model} ${short(secondsWith(row, model), 3)} s`).join(", "));
  add("Time on the machine", row.wall_s, () => `${row.wall_s.toPrecision(2)} s`
    + (known(row.wall_check_s) ? `, of that ${row.wall_check_s.toPrecision(2)} s for the check` : ""));
  definitions("figures", pairs.map(([term, text]) => [term, text()]).filter(([, text]) => text));
}
const secondsWith = (row, model) => row[model.replaceAll(" ", "_") + "_s"];
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
  drawPanels("watched", number, curves?.watched, row);
  drawPanels("decided", number, curves?.decided, row);
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
  const listed = traces.filter(trace => trace.showlegend).map(trace => trace.name);
  draw("curves", traces, curvesLayout(last, number, Boolean(curves.error), row, listed, namesOf(bands)));
  at("curves").setAttribute("aria-label", `Rotor angles, active model and error of ${row.name}`);
  const area = record.map.buses.some(bus => bus.study) ? "Rotor angles of the study area" : "Rotor angles";
  const further = curves.outside.length ? `, and of machines outside it that decided (${curves.outside.map(machineName).join(", ")}),` : "";
  say("curves-caption", `${area}${further} against the centre of inertia, and the model in use`
    + (curves.error ? "; below, the largest error of a rotor angle against the detailed run." : ".")
    + (row.status === "lost synchronism" ? " Dotted: the limit from which synchronism is lost." : "")
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
        name: plain(unit) + (critical ? " critical" : "") + (curves.outside.includes(unit) ? " outside" : ""), legendgroup: unit, showlegend: marked, legendrank: place,
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
function namesOf(bands) {
  // Models in use, the most exact one first.
  const used = new Set(bands.map(band => band.model)), known = Object.keys(MODELS).filter(model => used.has(model));
  return [...known, ...[...used].filter(model => !known.includes(model))];
}
function bandTraces(bands) {
  return namesOf(bands).map(model => {
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
function curvesLayout(last, number, error, row, listed, models) {
  // Room above for the legend and the buttons.
  const top = BUTTONS + 6 + legendHeight(listed, at("curves").clientWidth - 66);
  const usable = error ? 480 : 370, height = usable + 50 + top;
  // Heights in pixels, from below: error, model, angles.
  const below = error ? 100 / usable : 0, gap = 26 / usable, strip = 22 * Math.max(models.length, 1) / usable;
  const start = error ? below + gap : 0;
  const layout = {
    height, margin: {l: 56, r: 10, t: top, b: 40}, barmode: "overlay",
    legend: {orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: {size: 11}, tracegroupgap: 0},
    xaxis: axis("time (s)", {range: [0, last * 1.005 || 1], anchor: error ? "y3" : "y2"}),
    yaxis: axis("rotor angle (deg)", {domain: [start + strip + gap, 1]}),
    yaxis2: axis("", {domain: [start, start + strip], type: "category", fixedrange: true, showgrid: false,
      categoryorder: "array", categoryarray: [...models].reverse(), range: [-0.5, models.length - 0.5]}),
    shapes: record.events[number].faults.map(([x0, x1]) => ({type: "rect", yref: "paper", y0: 0, y1: 1,
      x0, x1: Math.min(x1, last), fillcolor: "#8b949e", opacity: 0.25, line: {width: 0}, layer: "below"})),
  };
  if (row.status === "lost synchronism") {
    for (const sign of [-1, 1]) layout.shapes.push(limitLine("y", sign * record.angle_limit_deg));
  }
  if (error) layout.yaxis3 = axis("error (deg)", {domain: [0, below], rangemode: "tozero", nticks: 4});
  return layout;
}

function limitLine(yref, value) {
  return {type: "line", xref: "paper", x0: 0, x1: 1, yref, y0: value, y1: value, line: {color: SOFT, width: 1.2, dash: "dot"}};
}

// ---- what is watched, and what decided -----------------------------------------------------------------------------

const PANEL = 190;

const PANEL_WORDS = {
  watched: ["Watched", watched => watched.left_out ? ` ${watched.left_out} curves that move less are left out.` : "", "What was watched of"],
  decided: ["What decided", () => " Dotted: what it is held against.", "What decided about"],
};

function drawPanels(id, number, found, row) {
  at(`${id}-figure`).hidden = !found;
  if (!found) return;
  const times = record.times[found.times];
  const traces = found.panels.flatMap((panel, k) => panelTraces(panel, k, times));
  draw(id, traces, watchedLayout(found.panels, times, number, at(id).clientWidth - 74));
  const [title, further, label] = PANEL_WORDS[id];
  at(id).setAttribute("aria-label", `${label} ${row.name}`);
  say(`${id}-caption`, `${title}: ${found.panels.map(panel => panel.axis).join(", ")}.${further(found)}`);
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
function watchedLayout(panels, times, number, width) {
  // Above each panel is its legend, above the first one the buttons too.
  const legends = panels.map(panel => 4 + legendHeight(panel.labels, width));
  const count = panels.length, top0 = BUTTONS + legends[0], last = times.at(-1) ?? 0;
  const usable = count * PANEL + legends.slice(1).reduce((sum, height) => sum + height, 0);
  const layout = {showlegend: true, height: usable + top0 + 50, margin: {l: 64, r: 10, t: top0, b: 50}};
  let above = 0;
  for (const [k, panel] of panels.entries()) {
    if (k) above += PANEL + legends[k];
    const suffix = k ? k + 1 : "", top = 1 - above / usable;
    layout[`yaxis${suffix}`] = axis(plain(panel.axis), {domain: [Math.max(0, top - PANEL / usable), top]});
    layout[`legend${suffix}`] = {orientation: "h", x: 0, y: top, yanchor: "bottom", font: {size: 11}};
  }
  layout.xaxis = axis("time (s)", {range: [0, last * 1.005 || 1], anchor: `y${count > 1 ? count : ""}`});
  layout.shapes = record.events[number].faults.map(([x0, x1]) => ({type: "rect", yref: "paper", y0: 0, y1: 1,
    x0, x1: Math.min(x1, last), fillcolor: "#8b949e", opacity: 0.25, line: {width: 0}, layer: "below"}));
  for (const [k, panel] of panels.entries()) {
    layout.shapes.push(...(panel.limits ?? []).map(value => limitLine(`y${k ? k + 1 : ""}`, value)));
  }
  return layout;
}

// ---- map -----------------------------------------------------------------------------------------

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
  if (!record.map.buses.length) { at("map-section").hidden = true; return; }
  const spots = faultSpots(events);
  const labels = spots.slice(0, 3).map(spot => ({x: spot.x, y: spot.y, text: `<b>${plain(spot.text)}</b>`,
    showarrow: true, arrowhead: 0, arrowcolor: INK, ax: 0, ay: -46, bgcolor: "rgba(255,255,255,0.88)"}));
  draw("map", [...gridTraces(), ...faultTraces(events, spots)], {annotations: labels,
    ...mapLayout(470),
  });
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
    height: 340 + BUTTONS, margin: {l: 54, r: 10, t: 38 + BUTTONS, b: 10}, bargap: 0.25, barmode: "overlay",
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
  const top = BUTTONS + 36;
  draw(id, traces, {height: 196 + top, margin: {l: 48, r: 10, t: top, b: 44}, barmode: "stack", showlegend: true,
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
  shown.all = true;
  drawRows(true);
  unfolded = [...document.querySelectorAll("details:not([open])")];
  for (const folded of unfolded) folded.open = true;
  for (const plot of document.querySelectorAll(".js-plotly-plot")) {
    plot.style.minWidth = "0";
    Plotly.relayout(plot, {width: plot.closest(".pair") ? 325 : 670});
  }
}
function afterPrint() {
  shown.all = false;
  drawRows(true);
  for (const folded of unfolded) folded.open = false;
  for (const plot of document.querySelectorAll(".js-plotly-plot")) {
    Plotly.relayout(plot, {width: null, autosize: true});
  }
}
function start() {
  header();
  widths();
  heads();
  rowLines();
  chips();
  fill();
  mapCaption();
  provenance();
  clearing();
  spreads();
  at("filter").addEventListener("input", event => { shown.text = event.target.value; fill(); });
  at("scroll").addEventListener("scroll", () => drawRows(), {passive: true});
  window.addEventListener("resize", () => { rowLines(); drawRows(true); });
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
