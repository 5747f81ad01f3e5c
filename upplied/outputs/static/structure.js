// A structure's page: picture, facts, required zones, plans, flights, findings and history.
"use strict";

(function () {
  const { element, badge, facts, format, minutes, table } = upplied, REACH = 0.02; // of the structure's size: findings nearer than that are one spot

  // The surface coloured by how many findings are near, all or of one class.
  function findings(app, data) {
    const structure = upplied.structures[data.id], marks = (data.marks || []).filter((row) => row.xyz);
    if (!marks.length || !structure || !upplied.draws3d()) return null;
    const pane = element("div", { class: "canvas", tabindex: 0, role: "img", "aria-label": "Findings on " + data.id + ". Arrow keys turn the view, plus and minus zoom, Home resets." });
    const classes = [...new Set(marks.map((row) => row.class))].sort();
    const chosen = element("select", { id: "finding-class", "aria-label": "Class of the findings shown" },
      element("option", { value: "" }, "all classes"), classes.filter(Boolean).map((name) => element("option", { value: name }, name)));
    const drawn = upplied.load("plotly.min.js").then(() => upplied.scene(pane, structure, { hfov_deg: 60, vfov_deg: 45 }, []));
    async function show() {
      const scene = await drawn, shown = marks.filter((row) => !chosen.value || row.class === chosen.value);
      const places = shown.map((row) => row.xyz.map((value, axis) => value - structure.origin[axis]));
      await scene.heat(places, REACH, "nearby findings");
      const at = Object.fromEntries(["x", "y", "z"].map((axis, k) => [axis, places.map((place) => place[k])]));
      await scene.overlay("findings", at, { mode: "markers", marker: { size: 4, color: upplied.colour("--ink") } });
      app.setAttribute("data-drawn", "true");
    }
    chosen.addEventListener("change", show);
    show();
    return element("section", {}, element("h2", {}, "Findings on the surface"), element("div", { class: "tools" }, chosen), pane);
  }

  upplied.pages.structure = function (app, data) {
    const section = (title, content) => (content ? element("section", {}, element("h2", {}, title), content) : null);
    const shown = upplied.structures[data.id], kind = shown ? " of kind " + upplied.words(shown.kind) : "";
    document.title = data.map ? "Findings on all structures" + kind + ", shown on " + data.id : data.id;
    upplied.fill(app,
      element("header", { class: "page" }, data.alone ? null : element("a", { href: upplied.home }, "All plans"), element("h1", {}, document.title)),
      element("div", { class: "beside" }, facts(data.facts),
        data.picture ? element("img", { class: "shown", src: data.picture, alt: "A plan for " + data.id, loading: "lazy" }) : null),
      data.findings.length ? section("Model checks", element("ul", {}, data.findings.map((each) => element("li", {}, each)))) : null,
      data.map ? null : section("Required zones", data.zones.length ? upplied.zones(data.zones)
        : element("p", { class: "note" }, "No zones are required.")),
      findings(app, data),
      (data.marks || []).length ? section("Findings", table("Findings", ["Finding", "Class", "Severity", "State", "Place, m", "Error", "Length", "Photo", "By"],
        data.marks.map((row) => [row.finding, row.class, row.severity, row.state, row.place, format(row.error, 2, " m"), format(row.length, 0, " mm"), row.photo, row.by]))) : null,
      data.map ? null : section("Plans", table("Plans", ["Demonstration", "Result", "Decision", "Inspected", "mm/px", "Clearance", "Time", "Planned"], data.plans.map((plan) => [
        element("a", { href: upplied.link("transfers", plan.pair) }, plan.demonstration + (plan.preset === "recommended" ? "" : ", " + plan.preset)), badge(plan.status), plan.state,
        format(plan.coverage, 1, " %"), format(plan.gsd, 1), format(plan.clearance, 1, " m"), minutes(plan.duration), plan.planned]))),
      data.map ? null : section("Flights", data.flights.length
        ? table("Flights", ["Flown", "Plan", "Operator", "Share of the plan", "Clearance", "Findings"], data.flights.map((row) => [row.when, row.plan, row.operator, format(row.share, 0, " %"), format(row.clearance, 1, " m"), row.findings]))
        : element("p", { class: "note" }, "No flight was imported yet.")),
      data.history.length ? section("Decisions", table("Decisions", ["Time", "Decision", "Note"], data.history.map((row) => [row.when, row.what, row.note]))) : null);
  };
})();
