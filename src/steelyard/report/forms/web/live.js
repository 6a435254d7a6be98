"use strict";
(() => {
const labels = /* numbers */ null;
const MOST = 2000, NS = "http://www.w3.org/2000/svg";
const PLACES = [[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]];
const at = (id) => document.getElementById(id);
let points = [], events = [], scheduled = false;

const ten = (mass, place, inertia) => [mass, ...(place || [null, null, null]), ...PLACES.map(([i, j]) => (inertia ? inertia[i][j] : null))];

function digits(deviation, value) {
  const scale = deviation || Math.abs(value) * 1e-3;
  return scale > 0 ? Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(scale)))) : 3;
}

function shown(value, deviation) {
  if (value === null || value === undefined) return "not told yet";
  const d = digits(deviation, value), own = value.toFixed(d).replace("-", "−");
  return deviation === null || deviation === undefined ? own : `${own} ± ${deviation.toFixed(d)}`;
}

function element(name, attributes, parent) {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (parent) parent.append(made);
  return made;
}

function panel(home, [name, unit, factor], read) {
  const figure = document.createElement("figure"), caption = document.createElement("figcaption");
  const title = document.createElement("span"), output = document.createElement("output");
  title.textContent = `${name} [${unit}]`;
  caption.append(title, output);
  const svg = element("svg", { role: "img", "aria-label": `${name} over time` });
  figure.append(caption, svg);
  at(home).append(figure);
  return { svg, output, factor, read };
}

const panels = [
  ...labels.ten.map((label, i) => panel("ten", label, (p) => [p.value[i], p.deviation[i]])),
  ...labels.left_over.map((label, i) => panel("left_over", label, (p) => [p.left ? p.left[i] : null, null])),
];

function take(record) {
  const sigma = record.standard_deviation;
  points.push({
    t: record.t, value: ten(record.mass, record.center_of_gravity, record.inertia),
    deviation: ten(sigma.mass, sigma.center_of_gravity, sigma.inertia),
    left: record.unmodelled,
  });
  for (const event of record.events) events.push(event);
  if (events.length > 200) events = events.slice(-200);
  if (points.length > MOST) {
    const old = points.length - MOST / 4;
    points = points.filter((_, i) => i >= old || i % 2 === 0);
  }
}

function range(rows) {
  // What the newer half of the time shows: the first bands are many times as wide as the last.
  const recent = rows.slice(Math.floor(rows.length / 2));
  let low = Infinity, high = -Infinity;
  for (const [, value, deviation] of recent) {
    low = Math.min(low, value - 2.2 * (deviation || 0));
    high = Math.max(high, value + 2.2 * (deviation || 0));
  }
  if (!(high > low)) { const room = Math.abs(low) * 0.01 || 1; low -= room; high += room; }
  const room = 0.12 * (high - low);
  return [low - room, high + room];
}

function draw({ svg, output, factor, read }) {
  const scaled = (x) => (x === null || x === undefined ? null : x * factor);
  const rows = [];
  let stretches = [[]];
  for (const p of points) {
    const [value, deviation] = read(p).map(scaled);
    if (value === null) { if (stretches.at(-1).length) stretches.push([]); continue; }
    const row = [p.t, value, deviation];
    rows.push(row);
    stretches.at(-1).push(row);
  }
  const last = points.length ? read(points.at(-1)).map(scaled) : [null, null];
  output.textContent = last[1] === null && last[0] !== null ? last[0].toFixed(2).replace("-", "−") : shown(...last);
  svg.replaceChildren();
  const width = svg.clientWidth || 300, height = svg.clientHeight || 120, left = 52, bottom = 18, top = 6, right = 8;
  const inner = { x: left, y: top, width: width - left - right, height: height - top - bottom };
  element("rect", { ...inner, class: "frame" }, svg);
  if (!rows.length) return;
  const first = points[0].t, end = Math.max(points.at(-1).t, first + 1);
  const [low, high] = range(rows);
  const x = (t) => left + inner.width * (t - first) / (end - first);
  const y = (v) => Math.min(top + inner.height, Math.max(top, top + inner.height * (high - v) / (high - low)));
  const d = digits((high - low) / 10, high);
  for (const [value, anchor] of [[high, top + 10], [low, top + inner.height]]) {
    element("text", { x: left - 6, y: anchor, "text-anchor": "end" }, svg).textContent = value.toFixed(Math.min(d, 4)).replace("-", "−");
  }
  element("text", { x: left, y: height - 4 }, svg).textContent = `${first.toFixed(1)} s`;
  element("text", { x: width - right, y: height - 4, "text-anchor": "end" }, svg).textContent = `${end.toFixed(1)} s`;
  if (low < 0 && high > 0) element("line", { x1: left, x2: width - right, y1: y(0), y2: y(0), class: "zero" }, svg);
  for (const event of events) {
    if (event.t >= first && event.t <= end) element("line", { x1: x(event.t), x2: x(event.t), y1: top, y2: top + inner.height, class: "event" }, svg);
  }
  for (const own of stretches) {
    if (!own.length) continue;
    if (own[0][2] !== null) {
      const over = own.map(([t, v, s]) => `${x(t).toFixed(1)},${y(v + 1.96 * s).toFixed(1)}`);
      const under = own.map(([t, v, s]) => `${x(t).toFixed(1)},${y(v - 1.96 * s).toFixed(1)}`).reverse();
      element("polygon", { points: [...over, ...under].join(" "), class: "band" }, svg);
    }
    element("polyline", { points: own.map(([t, v]) => `${x(t).toFixed(1)},${y(v).toFixed(1)}`).join(" "), class: "line" }, svg);
  }
}

function statements(home, texts) {
  at(home).replaceChildren(...texts.map((text) => {
    const item = document.createElement("li");
    item.className = "plain";
    item.textContent = text;
    return item;
  }));
}

function judge(record) {
  const lead = at("verdict");
  const [tone, sign, text] = record.accepted === null ? ["note", "!", "not judged yet"]
    : record.accepted ? ["good", "✓", "accepted"] : ["bad", "✗", "not accepted"];
  lead.className = `lead ${tone}`;
  const mark = document.createElement("span");
  mark.className = "sign";
  mark.setAttribute("aria-hidden", "true");
  mark.textContent = sign;
  if (lead.textContent !== sign + text) lead.replaceChildren(mark, text);
  statements("reasons", record.accepted === false ? record.reasons : []);
  at("load").textContent = `load: ${record.load}`;
  at("now").textContent = `${record.t.toFixed(1)} s`;
}

function told(event) {
  const weight = typeof event.mass === "number" ? `${event.mass < 0 ? "−" : "+"}${shown(Math.abs(event.mass), event.sigma_mass)} kg` : "";
  return [`${event.t.toFixed(1)} s`, event.kind, event.load, weight].filter((x) => x !== undefined && x !== "").join(", ");
}

let newest = null;
function redraw() {
  scheduled = false;
  if (newest) judge(newest);
  if (events.length) statements("events", events.map(told));
  panels.forEach(draw);
  document.body.dataset.shown = points.length;
}

function schedule() {
  if (!scheduled) { scheduled = true; setTimeout(() => requestAnimationFrame(redraw), 100); }
}

function connection(text, lost) {
  at("connection").textContent = text;
  at("connection").className = lost ? "lost" : "";
}

let begun = false;
const source = new EventSource("events");
// After a connection that was lost, all is told again.
source.addEventListener("open", () => { begun = false; connection("connected", false); });
source.addEventListener("estimates", (message) => {
  const records = JSON.parse(message.data);
  if (!begun) { points = []; events = []; begun = true; }
  records.forEach(take);
  newest = records.at(-1);
  schedule();
});
source.addEventListener("end", () => { source.close(); connection("ended", false); });
source.addEventListener("error", () => {
  if (source.readyState === EventSource.CLOSED) connection("not connected; load the page again", true);
  else connection("connection lost, connecting again", true);
});
new ResizeObserver(schedule).observe(at("ten"));
schedule();
})();
