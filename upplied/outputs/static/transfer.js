// A transfer's page: two 3-D views that fly together, what happens along the paths, and every figure.
"use strict";

(function () {
  const { element, badge, format, COLOURS, STATES } = upplied;
  const MEASURES = [
    ["coverage_inspected_pct", "Inspected, shown as finely", 1, " %", "Of the surface that the demonstration was about, the share that the plan shows sharply and no coarser than 1.1 times the demonstrated millimetres a pixel"],
    ["coverage_inspected_scaled_pct", "The same for its size", 1, " %", "Of that surface, the share that the plan shows from as near as the demonstration times the scale of the structure"],
    ["inspected_without_counterpart_pct", "Inspected, without counterpart", 1, " %", "Of that surface, what nothing on the target answers to; it counts as not shown"],
    ["inspected_unattainable_pct", "Inspected, unattainable", 1, " %", "Of that surface, what no safe viewpoint could show as well"],
    ["coverage_of_target_pct", "Of the target", 1, " %", "Of the target's surface that answers to what was inspected, the share shown as well"],
    ["coverage_context_pct", "Context", 1, " %", "Of what else the demonstration saw, the share that is seen"],
    ["acceptance_probability", "Probability of a good transfer", 2, "", "Forecast before planning that most of what was inspected can be shown"],
    ["counterpart_probability", "Probability of the right part", 2, "", "That the parts flown to are those that answer to the inspected ones; the least certain of them"],
    ["fidelity_resolution_p50", "Resolution kept, median", 2, "", "Best resolution of each patch over the one asked for"],
    ["fidelity_resolution_p05", "Resolution kept, 5th percentile", 2, "", "0 where a patch has no sharp look"],
    ["fidelity_looks_kept_pct", "Looks kept", 0, " %", "Of the directions from which patches were looked at"],
    ["fidelity_dwell_kept_pct", "Dwell kept", 0, " %", "Of the time for which patches were looked at"],
    ["fidelity_order", "Order kept", 2, "", "Kendall's tau of the moments at which patches are looked at"],
    ["fidelity_incidence_deg_p95", "More oblique by, 95th percentile", 0, "°", "Than the demonstration's most frontal look"],
    ["gsd_within_pct", "As fine as demonstrated", 1, " %", "Of the inspected surface that a safe camera can show so, what is no coarser than 1.1 times the demonstrated ground sample distance, in millimetres"],
    ["gsd_mm_p50", "Ground sample distance, median", 1, " mm", "Longer side of what a pixel covers, in the finest sharp look at each patch"],
    ["gsd_mm_p95", "Ground sample distance, 95th percentile", 1, " mm", ""],
    ["gsd_demonstrated_mm_p50", "Demonstrated ground sample distance, median", 1, " mm", ""],
    ["gsd_demonstrated_mm_p95", "Demonstrated ground sample distance, 95th percentile", 1, " mm", ""],
    ["blur_px_p50", "Blur by motion, median", 2, " px", "In that look, during the exposure"], ["blur_px_p99", "Blur by motion, 99th percentile", 2, " px", ""],
    ["defocus_px_p95", "Out of focus, 95th percentile", 2, " px", "The camera focused on the middle depth of what it sees"],
    ["camera_turn_ratio", "Camera turned", 1, " times", "Over what the demonstration turned"],
    ["path_turn_ratio", "Path turned", 1, " times", "Over what the demonstrated path turns"],
    ["pan_fast_pct", "Too fast for sharp pictures", 0, " %", "Share of the flight time"],
    ["coverage_seen_pct", "Really seen", 1, " %", "Share of the demonstrated surface's counterparts that the plan sees: in view and range, not hidden, not too oblique"],
    ["coverage_attainable_pct", "Attainable", 1, " %", "What any free viewpoint could see"],
    ["coverage_paper_pct", "Coverage as in the paper", 1, " %", "By camera frustum alone, nothing hides"],
    ["min_clearance_m", "Least clearance", 2, " m", "Of the whole path from the structure"],
    ["never_scanned_m2", "Never scanned", 0, " m\u00b2", "Surface that the target has where its scan is open, as the source tells; the path keeps clear of it"],
    ["surface_error_m", "Surface known to", 2, " m", "How far the surface of a scan may lie from where it is taken to be; kept beside the clearance"],
    ["margin", "Margin over the safety distance", 2, " m", "Least clearance less the distance that the plan was asked to keep"],
    ["frechet_z", "Fréchet, z-scored", 2, "", "Continuous, of the z-scored paths, as in the paper"],
    ["frechet_floored", "Fréchet, axes floored", 2, "", "The same with no axis divided by less than a tenth of the largest deviation"],
    ["frechet_m", "Fréchet, metres", 2, " m", "Continuous, after the boxes are matched"],
    ["standoff_ratio_p50", "Stand-off ratio, median", 2, "", "Planned over demonstrated"],
    ["incidence_p95_deg", "Incidence, 95th percentile", 0, "°", "0° looks straight at the surface"],
    ["path_length_m", "Path length", 0, " m", ""], ["duration_s", "Duration", 0, " s", ""],
    ["peak_speed_mps", "Peak speed", 1, " m/s", ""], ["peak_acceleration_mps2", "Peak acceleration", 1, " m/s²", ""],
    ["n_viewpoints", "Viewpoints", 0, "", ""], ["n_waypoints", "Waypoints", 0, "", ""],
  ];
  const CHARTS = [["speed", "Speed, m/s"], ["clearance", "Clearance, m"], ["standoff", "Stand-off, m"]];
  const AXIS = { zeroline: false, automargin: true };

  upplied.pages.transfer = function (app, data, back) {
    const demonstration = data.demonstration;
    const flown = upplied.path(demonstration.path);
    const planned = data.plans.filter((plan) => plan.path).map((plan) => ({
      name: plan.preset, colour: COLOURS[plan.preset] || COLOURS.recommended, path: upplied.path(plan.path),
      viewpoints: viewpoints(upplied.unpack(plan.viewpoints)), states: plan.states ? upplied.unpack(plan.states) : null,
    }));
    planned.push(...data.plans.filter((plan) => plan.flown).map((plan) => ({
      name: plan.preset + ", flown", colour: COLOURS.flown, path: upplied.path(plan.flown.path), viewpoints: [], states: plan.flown.states ? upplied.unpack(plan.flown.states) : null, width: 3, proof: plan.flown.kind === "flown",
    })));
    const main = data.plans[0];
    document.title = demonstration.id + " → " + data.target;

    const panes = [data.source, data.target].map((name, at) => element("div", { class: "canvas", tabindex: 0, role: "img",
      "aria-label": (at ? "planned for " : "demonstrated on ") + name + ": arrow keys turn the view, plus and minus zoom, Home resets" }));
    const readouts = [0, 1].map(() => element("p", { class: "readout" }));
    const charts = element("div", { class: "charts", id: "charts" });
    const slider = element("input", { type: "range", id: "time", min: 0, max: 1000, value: 0, step: 1, "aria-label": "Share of the flight, in thousandths" });
    const clock = element("output", { class: "clock", for: "time" });
    const play = element("button", { type: "button", id: "play" }, "Play");
    const aboard = element("input", { type: "checkbox", id: "aboard" });
    const frusta = element("input", { type: "checkbox", id: "frusta", checked: true });
    const toggles = planned.map((track, at) => element("input", { type: "checkbox", id: "show-" + track.name.replace(", ", "-"), checked: at === 0 || track.name === "newer draft" || track.name === planned[0].name + ", flown" }));
    const colourBy = element("select", { id: "colour-by", "aria-label": "Colour the surface by" },
      element("option", { value: "" }, "plain surface"),
      planned.map((track, at) => (track.states ? element("option", { value: at, selected: at === 0 }, "surface by " + track.name) : null)));

    upplied.fill(app,
      element("header", { class: "page" },
        element("a", { class: "back", href: back }, "All transfers"),
        element("h1", {}, demonstration.id, element("span", { class: "arrow" }, " → "), data.target, " ", badge(main.status)),
        element("p", { class: "sub" }, data.kind + ", demonstrated on " + data.source + (demonstration.operator ? " by " + demonstration.operator : "") + (demonstration.site ? ", " + demonstration.site : ""))),
      upplied.verdicts(data.plans),
      data.plans.filter((plan) => plan.overruled && plan.overruled.length).map((plan) => element("section", { class: "verdict not-flyable" },
        element("h2", {}, plan.preset + ": rules were overruled"), element("ul", {}, plan.overruled.map((said) => element("li", {}, said))))),
      data.plans.filter((plan) => plan.decided && plan === main).map((plan) => element("p", { class: "note decided" }, element("b", {}, plan.preset + ": "), plan.decided)),
      data.change ? element("p", { class: "note" }, data.change.startsWith("newer draft") ? data.change : "Since the plan before: " + data.change) : null,
      data.picture ? element("img", { class: "printed", src: data.picture, alt: "demonstrated on " + data.source + ", planned for " + data.target }) : null,
      element("section", { class: "views" },
        element("figure", {}, element("figcaption", {}, line(COLOURS.demonstration), "demonstrated on " + data.source), panes[0], readouts[0]),
        element("figure", {}, element("figcaption", {}, "planned for " + data.target, planned.map((track, at) => element("label", { class: "check" }, toggles[at], line(track.colour), track.name))), panes[1], readouts[1])),
      element("div", { class: "flight" }, play, slider, clock,
        element("label", { class: "check" }, aboard, "through the camera"),
        element("label", { class: "check" }, frusta, "viewpoints"),
        planned.some((track) => track.states) ? colourBy : null),
      planned.some((track) => track.states) ? element("p", { class: "legend" }, STATES.map(([name, colour]) => element("span", { class: "check" }, swatch(colour), name))) : null,
      counterparts(main),
      upplied.downloads(data, panes),
      data.plans.filter((plan) => plan.flown).map((plan) => element("p", { class: "flown" }, element("b", {}, plan.preset + (plan.flown.kind === "flown" ? ", as flown. " : ", flown in simulation. ")), plan.flown.said)),
      zones(data.zones || []), charts, measures(data.plans), remarks(data));

    if (!upplied.draws3d()) {
      for (const each of app.querySelectorAll(".views, .flight, .legend")) each.hidden = true;
      const picture = app.querySelector(".printed");
      if (picture) picture.classList.add("instead");
      app.querySelector(".views").after(element("p", { class: "note", id: "no-3d" }, "This browser draws no 3-D views (WebGL is off)" + (picture ? "; the picture shows the same." : "; the figures below are complete.")));
      drawCharts(charts, [{ name: "demonstrated", colour: COLOURS.demonstration, path: flown }, ...planned], main.safety_m).then(() => app.setAttribute("data-drawn", "true"));
      return () => { Plotly.purge(charts); app.removeAttribute("data-drawn"); };
    }
    const left = upplied.scene(panes[0], upplied.structures[data.source], demonstration.camera,
      [{ name: "demonstrated", colour: COLOURS.demonstration, path: flown, viewpoints: every(flown, 60), states: demonstration.states ? upplied.unpack(demonstration.states) : null }]);
    const right = upplied.scene(panes[1], upplied.structures[data.target], demonstration.camera, planned);
    const drawn = drawCharts(charts, [{ name: "demonstrated", colour: COLOURS.demonstration, path: flown }, ...planned], main.safety_m);

    const print = () => [left, right].forEach((scene, at) => {
      const shot = scene.shot();
      panes[at].querySelectorAll(".shot").forEach((each) => each.remove());
      if (shot) panes[at].append(element("img", { class: "shot", src: shot, alt: panes[at].getAttribute("aria-label").split(":")[0] }));
    });
    window.addEventListener("beforeprint", print);

    let timer = null, busy = false, again = false;
    async function fly() {
      if (busy) { again = true; return; }
      busy = true;
      const share = slider.value / 1000;
      const first = Math.max(0, toggles.findIndex((toggle) => toggle.checked));
      const [one, many] = [await left.fly(share, aboard.checked, 0), await right.fly(share, aboard.checked, first)];
      readouts[0].textContent = reading(one[0]);
      readouts[1].textContent = many[first] ? reading(many[first]) : "no path";
      clock.textContent = (100 * share).toFixed(0) + " %";
      await drawn;
      await Plotly.relayout(charts, { "shapes[0].x0": 100 * share, "shapes[0].x1": 100 * share });
      busy = false;
      if (again) { again = false; fly(); }
    }
    function stop() { clearInterval(timer); timer = null; play.textContent = "Play"; }
    slider.addEventListener("input", fly);
    play.addEventListener("click", () => {
      if (timer) { stop(); return; }
      if (Number(slider.value) >= 1000) slider.value = 0;
      play.textContent = "Pause";
      const [step, wait] = upplied.still() ? [50, 1000] : [3, 60];
      timer = setInterval(() => { slider.value = Number(slider.value) + step; fly(); if (Number(slider.value) >= 1000) stop(); }, wait);
    });
    aboard.addEventListener("change", async () => { if (!aboard.checked) { await left.home(); await right.home(); } fly(); });
    const repaint = () => { left.visible(0, true, frusta.checked); toggles.forEach((toggle, at) => right.visible(at, toggle.checked, frusta.checked)); };
    [frusta, ...toggles].forEach((input) => input.addEventListener("change", () => { repaint(); fly(); }));
    const proof = planned.findIndex((track) => track.proof && track.states); // what was truly flown and seen comes first
    colourBy.addEventListener("change", () => right.coloured(colourBy.value === "" ? new Uint8Array(upplied.unpack(upplied.structures[data.target].triangles).length / 3) : planned[colourBy.value].states));
    Promise.all([left.ready, right.ready, drawn]).then(() => { repaint(); if (proof > 0) { colourBy.value = proof; colourBy.dispatchEvent(new Event("change")); } return fly(); }).then(() => app.setAttribute("data-drawn", "true"));
    return () => { stop(); window.removeEventListener("beforeprint", print); left.purge(); right.purge(); Plotly.purge(charts); app.removeAttribute("data-drawn"); };
  };

  function reading(pose) {
    return pose.time.toFixed(1) + " s · " + format(pose.speed, 1, " m/s") + " · clearance " + format(pose.clearance, 1, " m") + " · stand-off " + format(pose.standoff, 1, " m");
  }
  const line = (colour) => { const made = element("i", { class: "line" }); made.style.background = colour; return made; };
  const swatch = (colour) => { const made = element("i", { class: "swatch" }); made.style.background = colour; return made; };

  function every(path, most) {
    const count = Math.min(most, path.count);
    return Array.from({ length: count }, (_, at) => path.at(count > 1 ? at / (count - 1) : 0));
  }
  function viewpoints(values) {
    return Array.from({ length: values.length / 7 }, (_, at) => ({ xyz: Array.from(values.slice(7 * at, 7 * at + 3)), quat: Array.from(values.slice(7 * at + 3, 7 * at + 7)) }));
  }

  function drawCharts(root, tracks, safety) {
    const traces = CHARTS.flatMap(([key], row) => tracks.map((track) => ({
      x: Array.from(track.path.t, (time) => (100 * time) / (track.path.duration || 1)),
      y: Array.from(track.path[key], (value) => (Number.isFinite(value) ? value : null)),
      mode: "lines", name: track.name, legendgroup: track.name, showlegend: row === 0, yaxis: "y" + (row ? row + 1 : ""),
      line: { color: track.colour, width: track.name in COLOURS ? 2 : 1.5, dash: { paper: "dash", baseline: "dot" }[track.name] || "solid" },
      hovertemplate: "%{y:.2f}",
    })));
    const height = 0.27, gap = 0.095;
    const layout = { height: 500, margin: { l: 50, r: 10, t: 56, b: 40 }, hovermode: "x unified", paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: 12, color: upplied.colour("--ink") }, legend: { orientation: "h", y: 1.06, yanchor: "bottom" },
      xaxis: { ...AXIS, gridcolor: upplied.colour("--line"), title: { text: "share of the flight, %" }, range: [0, 100], anchor: "y3" },
      shapes: [{ type: "line", xref: "x", yref: "paper", x0: 0, x1: 0, y0: 0, y1: 1, line: { color: upplied.colour("--ink"), width: 1 } }], annotations: [] };
    CHARTS.forEach(([, title], row) => {
      const top = 1 - row * (height + gap);
      layout["yaxis" + (row ? row + 1 : "")] = { ...AXIS, gridcolor: upplied.colour("--line"), domain: [Math.max(0, top - height), top], rangemode: "tozero" };
      layout.annotations.push({ text: title, xref: "paper", yref: "paper", x: 0, y: top, xanchor: "left", yanchor: "bottom", showarrow: false });
    });
    if (safety) {
      layout.shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: "y2", y0: safety, y1: safety, line: { color: "#d55e00", width: 1.5, dash: "dashdot" } });
      layout.annotations.push({ text: "safety distance " + safety + " m", xref: "paper", x: 1, xanchor: "right", yref: "y2", y: safety, yanchor: "bottom", showarrow: false, font: { color: upplied.colour("--orange"), size: 11 } });
    }
    return Plotly.newPlot(root, traces, layout, { displaylogo: false, responsive: true, displayModeBar: false });
  }

  function measures(plans) {
    const columns = plans.flatMap((plan) => [
      { name: plan.preset, colour: COLOURS[plan.preset], status: badge(plan.status), values: { ...plan.measures, margin: margin(plan, plan.measures) } },
      ...(plan.flown ? [{ name: plan.preset + ", flown", colour: COLOURS.flown, status: plan.flown.kind || "simulated", values: { ...plan.flown.measures, margin: margin(plan, plan.flown.measures) } }] : []),
    ]);
    const rows = MEASURES.filter(([key]) => columns.some(({ values }) => Number.isFinite(values[key])));
    return element("section", {}, element("h2", {}, "Figures"), element("div", { class: "scroll" }, element("table", { class: "figures" },
      element("thead", {}, element("tr", {}, element("th", { scope: "col" }, "Measure"), columns.map(({ name, colour }) => element("th", { scope: "col" }, line(colour || "#888888"), name)))),
      element("tbody", {},
        element("tr", {}, element("th", { scope: "row" }, "Status"), columns.map(({ status }) => element("td", {}, status))),
        rows.map(([key, label, digits, unit, help]) => element("tr", {}, element("th", { scope: "row", title: help }, label), columns.map(({ values }) => element("td", {}, format(values[key], digits, unit)))))))));
  }

  // What corresponds to each inspected part, and by its colour how sure that is.
  function counterparts(plan) {
    if (!plan.parts.length) return null;
    const columns = [["inspected", "Of what was inspected"], ["found", "Like it on the target"], ["flown", "Flown to"], ["left_out", "Left out"]];
    return element("section", { class: "counterparts" }, element("h2", {}, "Which part is it?"),
      element("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Inspected parts" }, element("table", { class: "figures" },
        element("thead", {}, element("tr", {}, ["Inspected part", "The right one", ...columns.map(([, label]) => label)].map((label) => element("th", { scope: "col" }, label)))),
        element("tbody", {}, plan.parts.map((one) => element("tr", { title: one.doubt },
          element("td", {}, one.part), element("td", {}, element("span", { class: "certainty " + one.sure }, one.probability)),
          columns.map(([key]) => element("td", {}, one[key] || "–"))))))),
      plan.parts.filter((one) => one.doubt).map((one) => element("p", { class: "note" }, one.doubt)));
  }

  // What must be seen of the structure, and whether it is: by the plans in force, and by what was flown.
  function zones(rows) {
    if (!rows.length) return null;
    const said = (row, what) => element("td", { class: row[what] === "met" ? "" : "warned" }, element("b", {}, row[what]), Number.isFinite(row[what + "_pct"]) ? " " + format(row[what + "_pct"], 1, " %") : "", element("div", { class: "note" }, row[what + "_why"]));
    return element("section", { class: "zones" }, element("h2", {}, "Zones that must be seen"), element("div", { class: "scroll" }, element("table", { class: "figures" },
      element("thead", {}, element("tr", {}, ["Zone", "As planned", "As flown", "Asked by"].map((title) => element("th", { scope: "col" }, title)))),
      element("tbody", {}, rows.map((row) => element("tr", {}, element("th", { scope: "row" }, row.zone), said(row, "planned"), said(row, "flown"), element("td", {}, row.asked_by + ": " + row.set + ", version " + row.version)))))));
  }

  function margin(plan, values) {
    return plan.safety_m && Number.isFinite(values.min_clearance_m) ? values.min_clearance_m - plan.safety_m : null;
  }

  function passport(data) {
    const said = data.demonstration.passport || "not judged";
    return data.back ? element("a", { href: "../demonstrations/" + data.demonstration.id + ".html" }, said) : said;
  }

  function remarks(data) {
    const facts = (pairs) => element("dl", {}, pairs.filter(([, value]) => value).flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
    return element("section", {}, element("h2", {}, "Where this comes from"),
      facts([["Demonstration", data.demonstration.id + ", " + data.demonstration.poses + " poses"], ["Passport", passport(data)], ["Source", upplied.structures[data.source].findings], ["Target", upplied.structures[data.target].findings], ["Notes", data.demonstration.notes], ["About", data.demonstration.about || "inferred from the flight: the coloured surface on the left"]]),
      data.plans.map((plan) => element("details", { open: plan === data.plans[0] }, element("summary", {}, plan.preset),
        facts([["Counterparts", plan.counterparts], ["Parts told by", plan.told_by], ["Stand-off", plan.standoff], ["Evidence", plan.evidence], ...Object.entries(plan.provenance).map(([name, value]) => [name.replaceAll("_", " "), value])]))));
  }
})();
