// The pages of a structure (facts, zones, plans, flights, findings, history) and of a demonstration (its import, in a picture and figures).
"use strict";

(function () {
  const { element, badge, facts, format, list, minutes, note, section } = upplied, REACH = 0.02; // of the structure's size: findings nearer than that are one spot

  // The surface coloured by how many findings are near, all or of one class.
  function heatMap(app, data) {
    const structure = upplied.structures[data.id], marks = (data.marks || []).filter((row) => row.xyz);
    if (!marks.length || !structure || !upplied.draws3d()) return null;
    const pane = upplied.pane("Findings on " + data.id), classes = [...new Set(marks.map((row) => row.class))].sort();
    const option = (value, label) => element("option", { value }, label);
    const chosen = element("select", { id: "finding-class", "aria-label": "Class of the findings shown", onchange: show }, option("", "all classes"), classes.filter(Boolean).map((name) => option(name, name)));
    const drawn = upplied.load("plotly.min.js").then(() => upplied.scene(pane, structure, { hfov_deg: 60, vfov_deg: 45 }, []));
    async function show() {
      const scene = await drawn, shown = marks.filter((row) => !chosen.value || row.class === chosen.value);
      const places = shown.map((row) => row.xyz.map((value, axis) => value - structure.origin[axis]));
      await scene.heat(places, REACH, "nearby findings");
      await scene.overlay("findings", places, { mode: "markers", marker: { size: 4, color: upplied.colour("--ink") } });
      app.setAttribute("data-drawn", "true");
    }
    show();
    return section("Findings on the surface", element("div", { class: "tools" }, chosen), pane);
  }

  upplied.pages.structure = function (app, data) {
    const table = (title, columns, rows, cells, empty = null) => (rows.length ? section(title, upplied.table(title, columns, rows.map(cells))) : empty && section(title, note(empty)));
    const own = (content) => (data.map ? null : content); // what concerns this structure alone
    const shown = upplied.structures[data.id], kind = shown ? " of kind " + upplied.words(shown.kind) : "";
    document.title = data.map ? "Findings on all structures" + kind + ", shown on " + data.id : data.id;
    upplied.fill(app,
      element("header", { class: "page" }, data.alone ? null : element("a", { href: upplied.home }, "All plans"), element("h1", {}, document.title)),
      element("div", { class: "beside" }, facts(data.facts),
        data.picture ? element("img", { class: "shown", src: data.picture, alt: "A plan for " + data.id, loading: "lazy" }) : null),
      data.findings.length ? section("Model checks", list(data.findings)) : null,
      own(section("Required zones", data.zones.length ? upplied.zones(data.zones) : note("No zones are required."))),
      heatMap(app, data),
      table("Findings", ["Finding", "Class", "Severity", "State", "Place (m)", "Error", "Length", "Photo", "By"], data.marks || [],
        (row) => [row.finding, row.class, row.severity, row.state, row.place, format(row.error, 2, " m"), format(row.length, 0, " mm"), row.photo, row.by]),
      own(table("Plans", ["Demonstration", "Result", "Decision", "Inspected", "mm/px", "Clearance", "Time", "Planned (UTC)"], data.plans, (plan) => [
        element("a", { href: upplied.link("transfers", plan.pair) }, plan.demonstration + (plan.preset === "recommended" ? "" : ", " + plan.preset)), badge(plan.status), plan.state,
        format(plan.coverage, 1, " %"), format(plan.gsd, 1), format(plan.clearance, 1, " m"), minutes(plan.duration), plan.planned], "There is no plan yet.")),
      own(table("Flights", ["Flown (UTC)", "Plan", "Operator", "Share of the plan", "Clearance", "Findings"], data.flights,
        (row) => [row.when, row.plan, row.operator, format(row.share, 0, " %"), format(row.clearance, 1, " m"), row.findings], "No flight was imported yet.")),
      table("Decisions", ["Time (UTC)", "Decision", "Note"], data.history, (row) => [row.when, row.what, row.note]));
  };

  upplied.pages.about = function (app, data) {
    document.title = data.id;
    upplied.fill(app,
      element("header", { class: "page" }, element("a", { href: upplied.home }, "All plans"), element("h1", {}, data.id),
        element("p", { class: "sub" }, "Flown round " + data.structure + (data.operator ? " by " + data.operator : "") + ", " + data.poses + " poses." + (data.notes ? " Notes: " + data.notes : ""))),
      data.verdict
        ? element("section", { class: "verdict " + (data.verdict === "refused" ? "refused" : "ok") }, element("h2", {}, "Import checks: " + data.verdict),
          list(data.findings.map((one) => [element("strong", {}, one.rule), one.overruled ? " (overruled)" : "", ": " + one.found + " ", element("i", {}, one.remedy)])) || element("p", {}, "No findings."))
        : element("p", {}, "This log was imported without checks. Import it again to have it checked."),
      element("div", { class: "beside" }, element("img", { class: "shown", src: data.picture, alt: "The path of " + data.id + " round " + data.structure }),
        data.figures.length ? element("section", { class: "measured" }, element("h2", {}, "Measured at import"), facts(data.figures)) : null));
  };
})();
