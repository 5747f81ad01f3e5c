// Shared by all pages: the data, small constructors of elements, numbers in words. All text enters as text.
// Colours and labels come from the program: `labels.js`.
"use strict";

const upplied = { structures: {}, pages: {}, root: "", live: false };

upplied.SIGNS = { ok: "✓", refused: "!", failed: "×", "not flyable": "⊘", recalled: "⛔" };

// element("div", {class: "row", onclick: f}, "text", child, ...)
upplied.element = function (tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
  }
  return upplied.fill(node, ...children);
};

upplied.fill = function (parent, ...children) {
  parent.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return parent;
};

upplied.badge = (status) => upplied.element("span", { class: "badge " + (status in upplied.SIGNS ? status : "failed").replace(" ", "-") },
  (upplied.SIGNS[status] || "?") + " " + status);

// A number as text, without the sign of one that rounds to zero.
upplied.format = (value, digits, unit = "") => (Number.isFinite(value) ? value.toFixed(digits).replace(/^-(?=[0.]*$)/, "") + unit : "–");

upplied.duration = function (seconds) {
  if (!Number.isFinite(seconds)) return "–";
  const whole = Math.round(seconds);
  return Math.floor(whole / 60) + ":" + String(whole % 60).padStart(2, "0");
};

// Arrays travel as base64 of their little-endian bytes.
upplied.unpack = function ({ data, type }) {
  const kinds = { f4: Float32Array, u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };
  return new kinds[type](Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0)).buffer);
};

// A colour of the style sheet as it stands: light, dark or in print.
upplied.colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// The points of an array that holds x y z of each.
upplied.points = (values) => Array.from({ length: values.length / 3 }, (_, at) => values.subarray(3 * at, 3 * at + 3));

// Lowest and highest value of points along each axis.
upplied.bounds = (points) => [...(points[0] || [])].map((_, axis) => points.reduce(
  ([low, high], point) => [Math.min(low, point[axis]), Math.max(high, point[axis])], [Infinity, -Infinity]));

upplied.minutes = (seconds) => (Number.isFinite(seconds) ? upplied.duration(seconds) + " min" : "–");

// An identifier as words: wind_turbine becomes wind turbine.
upplied.words = (name) => String(name).replaceAll("_", " ");

// The mark of a line or of a surface, and an entry of a legend with it.
upplied.mark = function (kind, colour) {
  const mark = upplied.element("i", { class: kind });
  if (colour) mark.style.background = colour;
  return mark;
};
upplied.entry = (name, ...mark) => upplied.element("span", { class: "check" }, upplied.mark(...mark), name);

upplied.section = (title, ...content) => upplied.element("section", {}, upplied.element("h2", {}, title), content);
upplied.list = (items) => (items.length ? upplied.element("ul", {}, items.map((each) => upplied.element("li", {}, each))) : null);
upplied.note = (text, id = null) => upplied.element("p", { class: "note", id }, text);
upplied.tile = (value, label, kind = "", help = null) => upplied.element("div", { class: "tile " + kind, title: help },
  upplied.element("b", {}, value), upplied.element("span", {}, label));

upplied.megabytes = (value) => (value >= 1000 ? (value / 1000).toFixed(1) + " GB" : value.toFixed(0) + " MB");

// A script of the package, loaded when it is first needed; a page in one file has it already.
upplied.load = function (name) {
  if (window.Plotly) return Promise.resolve();
  return new Promise((done, failed) => document.head.append(
    upplied.element("script", { src: upplied.root + "assets/" + name, onload: done, onerror: () => failed(new Error(name + " is missing")) })));
};

upplied.facts = (pairs) => upplied.element("dl", {}, pairs.filter(([, value]) => value)
  .flatMap(([name, value]) => [upplied.element("dt", {}, name), upplied.element("dd", {}, value)]));

// table(caption, ["Column", ...], [[cell, ...], ...]): cells are text or elements; the first of a row is its head.
// On a phone each row becomes a card, unless the columns are to be compared.
upplied.table = function (caption, columns, rows, compared = false) {
  const { element } = upplied, forms = { number: /^(–|[-−]?\d[\d.,:]*( ?[%°]| [a-z/²]+)?)$/, date: /^\d{4}-\d\d-\d\d \d\d:\d\d$/ };
  const kinds = columns.map((_, at) => Object.keys(forms).find((kind) => rows.length && rows.every((cells) => typeof cells[at] === "string" && forms[kind].test(cells[at]))) || "text");
  const head = (cell, at) => element("th", { scope: "row", class: kinds[at] }, cell);
  const body = (cell, at) => element("td", { class: kinds[at], "data-label": typeof columns[at] === "string" ? columns[at] : null }, cell);
  return element("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": caption }, element("table", { class: "figures" + (compared ? "" : " cards") },
    element("thead", {}, element("tr", {}, columns.map((name, at) => element("th", { scope: "col", class: kinds[at] }, name)))),
    element("tbody", {}, rows.map((cells) => element("tr", {}, cells.map((cell, at) => (at ? body : head)(cell, at)))))));
};

// Required zones with their results, as planned and as flown.
upplied.zones = function (rows) {
  const { element } = upplied;
  const result = (row, what) => element("span", { class: row[what] === "met" ? "" : "warned" }, element("b", {}, row[what]),
    Number.isFinite(row[what + "_pct"]) ? " " + upplied.format(row[what + "_pct"], 1, " % shown") : "", element("span", { class: "note" }, " " + (row[what + "_why"] || "")));
  return upplied.table("Required zones", ["Zone", "Planned", "Flown", "Last seen", "Required by"],
    rows.map((row) => [row.zone, result(row, "planned"), result(row, "flown"), row.last_seen || "never", row.asked_by + ", set " + row.set + ", version " + row.version]));
};

// tabs([[name, opened], ...]): their bar, their panels, and how to show one; `opened` runs once, when its panel is first shown.
upplied.tabs = function (sheets) {
  const { element } = upplied, waiting = sheets.map(([, opened]) => opened), ids = sheets.map(([name]) => name.toLowerCase());
  const panels = ids.map((id, at) => element("section", { class: id, id: "panel-" + id, "aria-label": sheets[at][0] }));
  function show(chosen) {
    panels.forEach((panel, at) => { panel.hidden = at !== chosen; });
    const opened = waiting[chosen];
    waiting[chosen] = null;
    if (opened) opened();
  }
  const choices = ids.map((id, at) => element("label", { id: "tab-" + id }, element("input", { type: "radio", name: "tab", checked: at === 0, onchange: () => show(at) }), sheets[at][0]));
  return { panels, show, bar: element("div", { class: "tabs", role: "radiogroup", "aria-label": "Views of the plan" }, choices) };
};

// An asynchronous act, one at a time: of the calls that come while it runs, the last alone follows.
upplied.latest = function (act) {
  let running = false, next = null;
  return async function (...given) {
    next = given;
    if (running) return;
    running = true;
    try { while (next) { const now = next; next = null; await act(...now); } } finally { running = false; }
  };
};

upplied.draws3d = function () {
  try { return Boolean(document.createElement("canvas").getContext("webgl")); } catch { return false; }
};
