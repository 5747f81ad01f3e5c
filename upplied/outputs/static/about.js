// The page of a demonstration: its verdict at import, a picture and what was measured.
"use strict";

upplied.pages.about = function (app, data) {
  const { element, facts, list, section } = upplied;
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
