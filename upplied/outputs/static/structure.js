// A structure's page: picture, facts, required zones, plans, flights, findings and history.
"use strict";

upplied.pages.structure = function (app, data) {
  const { element, badge, facts, format, minutes, table } = upplied;
  const section = (title, content) => (content ? element("section", {}, element("h2", {}, title), content) : null);
  document.title = data.id;
  upplied.fill(app,
    element("header", { class: "page" }, element("a", { href: upplied.home }, "All plans"), element("h1", {}, data.id)),
    element("div", { class: "beside" }, facts(data.facts),
      data.picture ? element("img", { class: "shown", src: data.picture, alt: "A plan for " + data.id, loading: "lazy" }) : null),
    data.findings.length ? section("Findings of the model", element("ul", {}, data.findings.map((each) => element("li", {}, each)))) : null,
    section("Required zones", data.zones.length ? upplied.zones(data.zones)
      : element("p", { class: "note" }, "No zones are required.")),
    (data.marks || []).length ? section("Findings", table("Findings", ["Finding", "Class", "Severity", "State", "Place, m", "Error", "Length", "Photo", "By"],
      data.marks.map((row) => [row.finding, row.class, row.severity, row.state, row.place, format(row.error, 2, " m"), format(row.length, 0, " mm"), row.photo, row.by]))) : null,
    section("Plans", table("Plans", ["Demonstration", "Result", "Decision", "Inspected", "mm/px", "Clearance", "Time", "Planned"], data.plans.map((plan) => [
      element("a", { href: upplied.link("transfers", plan.pair) }, plan.demonstration + (plan.preset === "recommended" ? "" : ", " + plan.preset)), badge(plan.status), plan.state,
      format(plan.coverage, 1, " %"), format(plan.gsd, 1), format(plan.clearance, 1, " m"), minutes(plan.duration), plan.planned]))),
    section("Flights", data.flights.length
      ? table("Flights", ["Flown", "Plan", "Operator", "Share of the plan", "Clearance", "Findings"], data.flights.map((row) => [row.when, row.plan, row.operator, format(row.share, 0, " %"), format(row.clearance, 1, " m"), row.findings]))
      : element("p", { class: "note" }, "No flight was imported yet.")),
    data.history.length ? section("Decisions", table("Decisions", ["When", "Decision", "Note"], data.history.map((row) => [row.when, row.what, row.note]))) : null);
};
