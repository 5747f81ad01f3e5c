// A map of structures that have a place: dots by the state of their plans, north up, no tiles from elsewhere.
"use strict";

upplied.places = function (structures, rows) {
  const { element } = upplied;
  const known = Object.entries(structures).filter(([, each]) => Number.isFinite(each.lat));
  if (known.length < 2) return null;
  const state = (name) => (rows.find((row) => row.target === name) || { status: "ok" }).status;
  const middle = known.reduce((sum, [, each]) => sum + each.lat, 0) / known.length;
  const squeeze = Math.cos((middle * Math.PI) / 180);
  const at = known.map(([name, each]) => ({ name, x: each.lon * squeeze, y: -each.lat }));
  const [left, top] = ["x", "y"].map((axis) => Math.min(...at.map((each) => each[axis])));
  const size = Math.max(...["x", "y"].map((axis) => Math.max(...at.map((each) => each[axis])) - Math.min(...at.map((each) => each[axis]))), 1e-6);
  const svg = (tag, attributes, ...children) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    node.append(...children);
    return node;
  };
  const dots = at.map((each) => {
    const [x, y] = [20 + (560 * (each.x - left)) / size, 20 + (200 * (each.y - top)) / size];
    return svg("a", { href: upplied.link("structures", each.name) || "#" }, svg("circle", { cx: x, cy: y, r: 6, class: "dot " + state(each.name).replace(" ", "-") }, svg("title", {}, each.name + ": " + state(each.name))));
  });
  const length = (size / 4) * 111.2;
  const unit = length >= 1 ? length.toFixed(0) + " km" : (1000 * length).toFixed(0) + " m";
  return element("details", { class: "places" }, element("summary", {}, "Map of " + known.length + " structures"),
    svg("svg", { viewBox: "0 0 620 250", role: "group", "aria-label": "Places of structures, north up" }, ...dots,
      svg("path", { d: "M600 40 V14 M594 22 L600 12 L606 22", class: "north" }), svg("text", { x: 600, y: 54, "text-anchor": "middle" }, "N"),
      svg("path", { d: "M20 240 H160", class: "north" }), svg("text", { x: 90, y: 234, "text-anchor": "middle" }, unit)));
};
