// The map of critical clearing times.

const rows = record.rows.map((values, rank) =>
  ({rank, ...Object.fromEntries(record.fields.map((field, k) => [field, values[k]]))}));

// Bars of the most critical places; places of a map from which it is drawn as an image, not as shapes.
const BARS = 30, MANY = 800;
// What stands beside the classes of times: a sign for each, which needs no colour.
const NEVER = {color: "#fff", line: "#0072b2", symbol: "circle-open"};
const FAILED = {color: "#d55e00", line: "#d55e00", symbol: "x-thin-open"};
const shown = {group: "all", text: "", sort: null, descending: false, chosen: null, found: []};

// ---- words ---------------------------------------------------------------------------------------

const ms = value => short(value, 3);
function classWords({above, up_to: upTo}) {
  if (above === null && upTo === null) return "all times";
  if (above === null) return `up to ${ms(upTo)} ms`;
  return upTo === null ? `above ${ms(above)} ms` : `${ms(above)} to ${ms(upTo)} ms`;
}
const neverWords = `stable up to ${ms(record.longest_ms)} ms`;
// The largest time of the grid that is stable, as a figure of the table.
function timeText(row) {
  if (row.group === "failed") return "failed";
  if (row.group === "never") return `≥ ${ms(row.cct_ms)}`;
  return row.cct_ms === 0 ? `< ${ms(row.lost_ms)}` : ms(row.cct_ms);
}
function bracket(row) {
  return known(row.lost_ms) ? `${ms(row.cct_ms)} – ${ms(row.lost_ms)}` : "";
}
const named = row => row.name ? `${row.place} (${row.name})` : row.place;
function sentence(row) {
  if (row.group === "failed") return `not found: ${row.reason}`;
  if (row.group === "never") return neverWords;
  const least = row.cct_ms === 0 ? `no clearing time of ${ms(row.lost_ms)} ms or more is stable`
    : `${ms(row.cct_ms)} ms stable, ${ms(row.lost_ms)} ms not`;
  if (row.machine) {
    const how = row.status === "off speed" ? "is off speed first" : "loses synchronism first";
    return `${least}: machine ${machineName(row.machine)} ${how}`;
  }
  return `${least}: ${row.status}`;
}

// ---- header --------------------------------------------------------------------------------------

function header() {
  const {settings, counts} = record;
  say("case", record.case);
  const model = settings.model ? ` Model: ${settings.model}.` : "";
  say("about", `Three-phase faults. The critical clearing time is the longest on a grid of ${ms(record.resolution_ms)} ms `
    + `for which no machine loses synchronism within ${settings.t_end} s.${model}`);
  const timed = rows.filter(row => typeof row.group === "number");
  if (timed.length) {
    tile(`${timeText(timed[0])} ms`, `shortest: ${named(timed[0])}`);
    tile(`${ms(timed[timed.length >> 1].cct_ms)} ms`, "median of places with a limit");
  }
  tile(rows.length, `of ${many(counts.total, "place")} examined`);
  tile(counts.never, neverWords);
  if (counts.failed) tile(counts.failed, "could not be found");
  if (counts.waiting) banner(`Not finished: ${rows.length} of ${counts.total} places are known. The work can be resumed.`, []);
  if (counts.failed) {
    banner("Some clearing times could not be found.", rows.filter(row => row.group === "failed").slice(0, 6)
      .map(row => `${named(row)}: ${row.reason}`));
  }
}
function tile(figure, words) {
  const made = element("li");
  made.append(element("b", figure), words);
  at("verdicts").append(made);
}

// ---- legend, which is a filter too ---------------------------------------------------------------

function groups() {
  const {classes, counts} = record;
  return [
    {group: "all", words: "all", count: rows.length},
    ...classes.map((item, k) => ({group: k, words: classWords(item), count: item.count, ...styleOf(k)})),
    {group: "never", words: neverWords, count: counts.never, ...NEVER},
    {group: "failed", words: "failed", count: counts.failed, ...FAILED},
  ].filter(item => item.group === "all" || item.count);
}
function styleOf(group) {
  if (group === "never") return NEVER;
  if (group === "failed") return FAILED;
  return {color: record.classes[group].color, line: "#1b1f24", symbol: "circle"};
}
// The shortest times are drawn largest.
function sizeOf(group) {
  if (group === "never") return 6;
  if (group === "failed") return 10;
  const few = Math.min(1, 240 / Math.max(rows.length, 1));
  return 7 + 7 * (1 - group / Math.max(record.classes.length, 1)) * (0.35 + 0.65 * few);
}
function legend() {
  at("legend").replaceChildren(...groups().map(item => {
    const button = element("button", null, {type: "button", "data-group": item.group,
      "aria-pressed": String(shown.group === item.group)});
    if (item.color) button.append(swatch(item));
    button.append(`${item.words}: ${item.count}`);
    button.addEventListener("click", () => { shown.group = item.group; shown.chosen = null; refresh(); });
    return button;
  }));
}
function swatch({color, line, group}) {
  const made = element("span", group === "failed" ? "✕" : null, {class: "swatch", "aria-hidden": "true"});
  if (group === "failed") made.style.color = color;
  else { made.style.background = color; made.style.borderColor = line; }
  return made;
}

// ---- map -----------------------------------------------------------------------------------------

function placeTrace({group, words, color, line, symbol}) {
  const own = rows.filter(row => row.group === group && (shown.group === "all" || shown.group === group)
    && matches(row));
  const size = sizeOf(group), onLine = group === "never" ? "triangle-up-open" : "triangle-up";
  const ends = own.some(row => row.line);
  return {type: rows.length > MANY ? "scattergl" : "scatter", mode: "markers", name: words, x: own.map(row => row.x), y: own.map(row => row.y),
    customdata: own.map(row => row.rank), showlegend: false,
    marker: {color: symbol.endsWith("open") ? line : color, size, line: {color: line, width: symbol.endsWith("open") ? 1.5 : 0.8},
      symbol: ends && group !== "failed" ? own.map(row => row.line ? onLine : symbol) : symbol},
    text: own.map(row => `<b>${plain(named(row))}</b><br>${plain(sentence(row))}`),
    hovertemplate: "%{text}<extra></extra>"};
}
function drawMap() {
  const {buses, branches} = record.map;
  const asked = new Set(rows.filter(row => !row.line).map(row => row.place));
  const rest = buses.filter(bus => !asked.has(`bus ${bus.number}`));
  const gl = rows.length > MANY ? "scattergl" : "scatter";
  // Long times first: what is most critical lies on top.
  const traces = groups().filter(item => item.group !== "all").map(placeTrace).reverse();
  draw("map", [
    {type: gl, mode: "lines", ...lines(branches), line: {color: "#c3c9d0", width: rows.length > MANY ? 0.7 : 1.1}, hoverinfo: "skip", showlegend: false},
    {type: gl, mode: "markers", x: rest.map(bus => bus.x), y: rest.map(bus => bus.y), showlegend: false,
      marker: {color: "#d5dae0", size: 3.5}, text: rest.map(bus => plain(busName(bus.number))),
      hovertemplate: "bus %{text}<br>not examined<extra></extra>"},
    ...traces,
  ], {...mapView(mapLayout(mapHeight())), annotations: mapLabel()});
}
// The part of the map in which places are; a double click shows all of it.
function mapView(layout) {
  const {view} = record;
  if (!view) return layout;
  return {...layout, xaxis: {...layout.xaxis, range: view.x}, yaxis: {...layout.yaxis, range: view.y}};
}
const mapHeight = () => Math.round(Math.min(640, Math.max(340, 0.62 * at("map-section").clientWidth)));
function mapLabel() {
  const row = shown.chosen;
  if (!row) return [];
  return [{x: row.x, y: row.y, text: `<b>${plain(named(row))}</b><br>${plain(row.group === "failed" ? "failed" : `${timeText(row)} ms`)}`,
    showarrow: true, arrowhead: 2, arrowcolor: INK, ax: 0, ay: -46, bgcolor: "rgba(255,255,255,0.92)", bordercolor: INK, borderpad: 3}];
}

// ---- bars ----------------------------------------------------------------------------------------

function drawBars() {
  const timed = matching().filter(row => typeof row.group === "number").sort((a, b) => a.rank - b.rank);
  const bars = timed.slice(0, BARS);
  at("bars").hidden = !bars.length;
  say("bars-words", bars.length < timed.length ? `The ${bars.length} shortest of ${timed.length} clearing times.`
    : bars.length ? `${many(bars.length, "clearing time")}, the shortest first.`
    : "No place that is shown has a clearing time up to which it is limited.");
  if (!bars.length) return;
  const most = Math.floor(at("bars-section").clientWidth / 17);
  const label = row => plain(named(row).length > most ? named(row).slice(0, most - 1) + "…" : named(row));
  draw("bars", [{type: "bar", orientation: "h", y: bars.map(row => row.rank), x: bars.map(row => row.cct_ms),
    customdata: bars.map(row => row.rank), text: bars.map(row => timeText(row)), textposition: "outside", cliponaxis: false,
    marker: {color: bars.map(row => styleOf(row.group).color), line: {color: INK, width: 0.6}},
    hovertext: bars.map(row => `<b>${plain(named(row))}</b><br>${plain(sentence(row))}`), hovertemplate: "%{hovertext}<extra></extra>"}], {
    height: 22 * bars.length + 66, margin: {l: 40, r: 34, t: 4, b: 40}, bargap: 0.25,
    xaxis: axis("critical clearing time (ms)", {rangemode: "tozero"}),
    yaxis: axis("", {type: "category", autorange: "reversed", tickmode: "array", tickvals: bars.map(row => row.rank),
      ticktext: bars.map(label), tickfont: {size: 11}, showgrid: false, fixedrange: true}),
  });
}

// ---- table ---------------------------------------------------------------------------------------

const COLUMNS = [
  {field: "place", head: "Place", text: true},
  {field: "name", head: "Bus", text: true, help: "name of the bus, for a line that at the fault"},
  {field: "base_kv", head: "Level", unit: "kV", show: row => row.base_kv ? short(row.base_kv, 3) : ""},
  {field: "area", head: "Area"},
  {field: "cct_ms", head: "CCT", unit: "ms", show: timeText, help: "critical clearing time: the longest of the grid that is stable"},
  {field: "lost_ms", head: "Bracket", unit: "ms", show: bracket, help: "stable at the first, not at the second"},
  {field: "machine", head: "First machine", text: true, show: row => row.machine ?? (row.group === "never" || row.group === "failed" ? "" : row.status),
    help: "the machine that loses synchronism first at the second time of the bracket"},
  {field: "runs", head: "Runs", help: "simulations made"},
];
const columns = COLUMNS.filter(({field}) => !["name", "area", "machine", "lost_ms"].includes(field)
  || (field === "area" ? new Set(rows.map(row => row.area)).size > 1 : rows.some(row => row[field])));

function heads() {
  for (const column of columns) {
    const head = element("th", null, {scope: "col", "data-field": column.field, class: column.text ? "text" : ""});
    const button = element("button", column.head, {type: "button", title: column.help ?? ""});
    if (column.unit) button.append(element("small", column.unit));
    button.addEventListener("click", () => {
      shown.descending = shown.sort === column.field && !shown.descending;
      shown.sort = column.field;
      fill();
    });
    head.append(button, element("span", [column.head, column.unit].filter(Boolean).join(", "), {class: "paper"}));
    at("heads").append(head);
  }
}
// Words of a row that the filter looks into; each word of the filter has to be in them.
const wordsOf = row => [row.place, row.name, row.machine, row.status, row.reason, `${row.base_kv}kv ${row.base_kv} kv`,
  `area ${row.area}`, `zone ${row.zone}`].join(" ").toLowerCase();
const texts = new Map(rows.map(row => [row, wordsOf(row)]));
function matches(row) {
  // A number belongs to the word before it: "area 1" is not "area 12".
  const items = shown.text.toLowerCase().match(/(?:area|zone|bus)\s+\S+|\S+\s+kv\b|\S+/g) ?? [];
  return items.every(item => {
    const whole = /^(?:area|zone|bus)\s/.test(item);
    const words = ` ${texts.get(row)} `;
    return whole ? words.includes(` ${item.split(/\s+/).join(" ")} `) : words.includes(item);
  });
}
const matching = () => rows.filter(row => (shown.group === "all" || row.group === shown.group) && matches(row));
function sorted(found) {
  if (!shown.sort) return found;
  const sign = shown.descending ? -1 : 1, field = shown.sort;
  const order = new Intl.Collator("en", {numeric: true});
  return [...found].sort((one, other) => {
    // Places without a limit come after all that have one, those that failed last.
    const a = field === "cct_ms" ? one.rank : one[field], b = field === "cct_ms" ? other.rank : other[field];
    if (!known(a) || !known(b)) return known(b) - known(a) || one.rank - other.rank;
    return sign * (typeof a === "string" ? order.compare(a, b) : a - b) || one.rank - other.rank;
  });
}
function fill() {
  for (const head of at("heads").children) {
    head.removeAttribute("aria-sort");
    if (head.dataset.field === shown.sort) head.setAttribute("aria-sort", shown.descending ? "descending" : "ascending");
  }
  shown.found = sorted(matching());
  at("body").replaceChildren(...shown.found.map(tableRow));
  say("caption", rows.length ? `${shown.found.length} of ${many(rows.length, "place")}.${shown.sort ? "" : " The shortest clearing time first."}`
    : "No clearing time is known yet.");
}
function tableRow(row) {
  const made = element("tr", null, {"data-rank": row.rank, title: sentence(row)});
  for (const [k, column] of columns.entries()) {
    const text = column.show ? column.show(row) : row[column.field] ?? "";
    const cell = element(k ? "td" : "th", k ? text : null, k ? {class: column.text ? "text" : ""} : {scope: "row", class: "text"});
    if (!k) cell.append(swatch({...styleOf(row.group), group: row.group}), element("button", text, {type: "button", class: "plain"}));
    made.append(cell);
  }
  made.addEventListener("click", () => choose(row));
  made.classList.toggle("chosen", shown.chosen === row);
  return made;
}
function choose(row, reveal = false) {
  shown.chosen = shown.chosen === row && !reveal ? null : row;
  for (const line of at("body").children) line.classList.toggle("chosen", Number(line.dataset.rank) === shown.chosen?.rank);
  Plotly.relayout(at("map"), {annotations: mapLabel()});
  if (!reveal) return;
  const line = at("body").querySelector(`tr[data-rank="${row.rank}"]`);
  if (line) at("scroll").scrollTop = line.offsetTop - at("scroll").clientHeight / 2;
}

// ---- start ---------------------------------------------------------------------------------------

function refresh() {
  legend();
  fill();
  drawMap();
  drawBars();
}
function beforePrint() {
  for (const plot of document.querySelectorAll(".js-plotly-plot")) Plotly.relayout(plot, {width: 670});
}
function afterPrint() {
  for (const plot of document.querySelectorAll(".js-plotly-plot")) Plotly.relayout(plot, {width: null, autosize: true});
}
function start() {
  header();
  heads();
  mapCaption();
  if (rows.some(row => row.line)) at("map-caption").append(" Triangles: faults at ends of lines, which trip them.");
  if (record.view) at("map-caption").append(" The part with places that were examined is shown first.");
  definitions("origin", record.provenance);
  refresh();
  for (const id of ["map", "bars"]) {
    if (at(id).on) at(id).on("plotly_click", event => {
      const rank = event.points[0].customdata;
      if (known(rank)) choose(rows[rank], true);
    });
  }
  at("filter").addEventListener("input", event => { shown.text = event.target.value; refresh(); });
  document.querySelector(".skip").addEventListener("click", event => { event.preventDefault(); at("ranking").focus(); });
  window.addEventListener("beforeprint", beforePrint);
  window.addEventListener("afterprint", afterPrint);
}
start();
