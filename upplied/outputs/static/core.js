// Shared by all pages: the data, small constructors of elements, numbers in words. All text enters as text.
"use strict";

const upplied = { structures: {}, pages: {} };

upplied.COLOURS = {
  demonstration: "#e69f00", recommended: "#0072b2", paper: "#009e73", baseline: "#cc79a7", flown: "#111820",
  "newer draft": "#d55e00",
};
upplied.STATES = [
  ["not inspected", "#c7cdd6"], ["shown", "#7db8e8"], ["missed", "#d55e00"],
  ["unattainable", "#f0e442"], ["no counterpart", "#8c7a99"],
  ["hardly inspected", "#d5e8e0"], ["partly inspected", "#8fcbb5"], ["inspected", "#2e9e7c"], ["seen if corrected", "#c9a0dc"],
];
upplied.SIGNS = { ok: "✓", refused: "!", failed: "×", "not flyable": "⊘", recalled: "⛔" };

// element("div", {class: "row", onclick: f}, "text", child, ...)
upplied.element = function (tag, attributes, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, value);
  }
  return upplied.fill(made, ...children);
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

upplied.draws3d = function () {
  try { return Boolean(document.createElement("canvas").getContext("webgl")); } catch { return false; }
};
