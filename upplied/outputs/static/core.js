// Shared by all pages: the data, small constructors of elements, numbers in words. All text enters as text.
"use strict";

const upplied = { structures: {}, pages: {}, root: "", live: false };

upplied.COLOURS = {
  demonstration: "#e69f00", recommended: "#0072b2", paper: "#009e73", baseline: "#cc79a7", flown: "#5f6b78",
  "newer draft": "#d55e00",
};
upplied.STATES = [
  ["not inspected", "#c7cdd6"], ["shown", "#7db8e8"], ["missed", "#d55e00"],
  ["unattainable", "#f0e442"], ["no counterpart", "#8c7a99"],
  ["hardly inspected", "#d5e8e0"], ["partly inspected", "#8fcbb5"], ["inspected", "#2e9e7c"], ["seen if corrected", "#c9a0dc"],
  ["in view only", "#b5651d"], ["inspected if corrected", "#7b3fa0"],
];
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

upplied.badge = function (status) {
  const known = status in upplied.SIGNS ? status : "failed";
  return upplied.element("span", { class: "badge " + known.replace(" ", "-") }, (upplied.SIGNS[status] || "?") + " " + status);
};

upplied.format = function (value, digits, unit) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return value.toFixed(digits) + (unit || "");
};

upplied.duration = function (seconds) {
  if (seconds === null || !Number.isFinite(seconds)) return "–";
  const whole = Math.round(seconds);
  return Math.floor(whole / 60) + ":" + String(whole % 60).padStart(2, "0");
};

// Arrays travel as base64 of their little-endian bytes.
upplied.unpack = function (packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  const kinds = { f4: Float32Array, u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };
  return new kinds[packed.type](bytes.buffer);
};

// A colour of the style sheet as it stands: light, dark or in print.
upplied.colour = function (name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
};

// Whether whoever reads asked for less motion.
upplied.still = function () {
  return window.matchMedia("(prefers-reduced-motion: reduce)").matches;
};

// The minutes and seconds of a flight, as people say them.
upplied.minutes = (seconds) => (Number.isFinite(seconds) ? upplied.duration(seconds) + " min" : "–");

// An identifier as words: wind_turbine becomes wind turbine.
upplied.words = (name) => String(name).replaceAll("_", " ");

// The mark of a line or of a surface in a legend.
upplied.mark = function (kind, colour) {
  const mark = upplied.element("i", { class: kind });
  mark.style.background = colour;
  return mark;
};

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
  const { element } = upplied;
  const all = (at, form) => rows.length && rows.every((cells) => typeof cells[at] === "string" && form.test(cells[at]));
  const kind = (at) => (all(at, /^(–|[-−]?\d[\d.,:]*( ?[%°]| [a-z/²]+)?)$/) ? "number" : all(at, /^\d{4}-\d\d-\d\d \d\d:\d\d$/) ? "date" : "text");
  return element("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": caption }, element("table", { class: "figures" + (compared ? "" : " cards") },
    element("thead", {}, element("tr", {}, columns.map((name, at) => element("th", { scope: "col", class: kind(at) }, name)))),
    element("tbody", {}, rows.map((cells) => element("tr", {}, cells.map((cell, at) => element(at ? "td" : "th", { scope: at ? null : "row", class: kind(at), "data-label": at && typeof columns[at] === "string" ? columns[at] : null }, cell)))))));
};

// Required zones with their results, as planned and as flown.
upplied.zones = function (rows) {
  const result = (row, what) => upplied.element("span", { class: row[what] === "met" ? "" : "warned" }, upplied.element("b", {}, row[what]),
    Number.isFinite(row[what + "_pct"]) ? " " + upplied.format(row[what + "_pct"], 1, " % shown") : "", row[what + "_why"] ? upplied.element("span", { class: "note" }, " " + row[what + "_why"]) : null);
  return upplied.table("Required zones", ["Zone", "Planned", "Flown", "Required by"],
    rows.map((row) => [row.zone, result(row, "planned"), result(row, "flown"), row.asked_by + ", set " + row.set + ", version " + row.version]));
};

// tabs([[name, panel, opened], ...]): `opened` runs once, when its panel is first shown.
upplied.tabs = function (sheets) {
  const { element } = upplied;
  const buttons = sheets.map(([name], at) => element("button", { type: "button", role: "tab", id: "tab-" + name.toLowerCase(),
    "aria-controls": "panel-" + name.toLowerCase(), onclick: () => show(at) }, name));
  const done = sheets.map(() => false);
  const bar = element("div", { class: "tabs", role: "tablist", "aria-label": "Views of the plan" }, buttons);
  sheets.forEach(([name, panel], at) => {
    for (const [key, value] of Object.entries({ role: "tabpanel", id: "panel-" + name.toLowerCase(), "aria-labelledby": buttons[at].id, tabindex: 0 })) panel.setAttribute(key, value);
  });
  bar.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const next = (buttons.indexOf(document.activeElement) + step + buttons.length) % buttons.length;
    show(next);
    buttons[next].focus();
  });
  function show(chosen) {
    sheets.forEach(([, panel, opened], at) => {
      panel.hidden = at !== chosen;
      buttons[at].setAttribute("aria-selected", String(at === chosen));
      buttons[at].tabIndex = at === chosen ? 0 : -1;
      if (at === chosen && !done[at]) { done[at] = true; if (opened) opened(); }
    });
  }
  return { bar, show };
};

upplied.draws3d = function () {
  try { return Boolean(document.createElement("canvas").getContext("webgl")); } catch { return false; }
};
