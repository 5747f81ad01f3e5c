// A plan's page in three tabs: what a pilot flies, what the pictures will show, and every figure for research.
"use strict";

(function () {
  const { element, badge, format, COLOURS, STATES } = upplied;
  const RESEARCH = [
    ["coverage_inspected_pct", "Inspected surface shown", 1, " %", "Share of the inspected surface that the plan shows at least as near, as frontally and as sharply; relative to the size of the target where stand-offs are scaled"],
    ["inspected_without_counterpart_pct", "Inspected surface without counterpart", 1, " %", "Share with no corresponding surface on the target; it counts as not shown"],
    ["inspected_unattainable_pct", "Inspected surface unattainable", 1, " %", "Share that no safe viewpoint can show as well"],
    ["coverage_of_target_pct", "Target surface covered", 1, " %", "Share of the target's corresponding surface that is shown as well"],
    ["coverage_context_pct", "Surroundings covered", 1, " %", "Share of the other surface in the demonstration's pictures that the plan sees"],
    ["acceptance_probability", "Probability of a good transfer", 2, "", "Forecast before planning"],
    ["counterpart_probability", "Probability of the right part", 2, "", "Probability of the least certain part"],
    ["fidelity_resolution_p50", "Resolution / required resolution, median", 2, "", "Best resolution of each patch"],
    ["fidelity_resolution_p05", "Resolution / required resolution, 5th percentile", 2, "", "0 where a patch has no sharp view"],
    ["fidelity_looks_kept_pct", "Repeated views retained", 0, " %", "Share of the demonstrated viewing directions"],
    ["fidelity_dwell_kept_pct", "Viewing time retained", 0, " %", "Share of the demonstrated viewing time"],
    ["fidelity_order", "Order of views retained", 2, "", "Kendall's tau of the times at which patches are seen"],
    ["fidelity_incidence_deg_p95", "More oblique than demonstrated, 95th percentile", 0, "°", "Against the demonstration's most frontal view"],
    ["gsd_within_pct", "As fine as demonstrated", 1, " %", "Share with a ground sample distance, in millimetres, of at most 1.1 times the demonstrated one, of the inspected surface that a safe camera can show so"],
    ["gsd_mm_p50", "Ground sample distance, median", 1, " mm/px", "Longer side of a pixel on the surface, in the finest sharp view of each patch"],
    ["gsd_mm_p95", "Ground sample distance, 95th percentile", 1, " mm/px", ""],
    ["gsd_demonstrated_mm_p50", "Demonstrated ground sample distance, median", 1, " mm/px", ""],
    ["gsd_demonstrated_mm_p95", "Demonstrated ground sample distance, 95th percentile", 1, " mm/px", ""],
    ["blur_px_p50", "Motion blur, median", 2, " px", "In the finest sharp view, during the exposure"],
    ["blur_px_p99", "Motion blur, 99th percentile", 2, " px", ""],
    ["defocus_px_p95", "Defocus, 95th percentile", 2, " px", "With the camera focused on the middle depth of its picture"],
    ["picture_score", "Picture score", 2, "", "Line of sight, sharpness and resolution of the best picture of each patch, as in the CARIC challenge"],
    ["camera_turn_ratio", "Camera rotation / demonstrated", 1, "", ""],
    ["path_turn_ratio", "Path curvature / demonstrated", 1, "", ""],
    ["pan_fast_pct", "Time with motion blur", 0, " %", "Share of the flight in which the picture moves too fast to be sharp"],
    ["coverage_seen_pct", "Demonstrated surface seen", 1, " %", "In view and in range, not occluded, not too oblique"],
    ["coverage_attainable_pct", "Attainable coverage", 1, " %", "Share that any free viewpoint could see"],
    ["coverage_paper_pct", "Coverage as in the paper", 1, " %", "By the camera's frustum alone, without occlusion"],
    ["min_clearance_m", "Minimum clearance", 2, " m", "Smallest distance of the whole path from the structure"],
    ["never_scanned_m2", "Never scanned", 0, " m\u00b2", "Surface that the target must have where its scan is open; the path stays clear of it"],
    ["surface_error_m", "Surface error of the scan", 2, " m", "The path adds this distance to the clearance"],
    ["margin", "Clearance above the limit", 2, " m", "Minimum clearance less the required one"],
    ["frechet_z", "Fréchet distance, standardised", 2, "", "Continuous, of the standardised paths, as in the paper"],
    ["frechet_floored", "Fréchet distance, axes floored", 2, "", "No axis is divided by less than a tenth of the largest deviation"],
    ["frechet_m", "Fréchet distance, metres", 2, " m", "Continuous, after the boxes are matched"],
    ["standoff_ratio_p50", "Stand-off / demonstrated stand-off, median", 2, "", ""],
    ["incidence_p95_deg", "Incidence, 95th percentile", 0, "°", "0° is a frontal view"],
    ["path_length_m", "Path length", 0, " m", ""], ["duration_s", "Duration", 0, " s", ""],
    ["peak_speed_mps", "Peak speed", 1, " m/s", ""], ["peak_acceleration_mps2", "Peak acceleration", 1, " m/s²", ""],
    ["n_viewpoints", "Viewpoints", 0, "", ""], ["n_waypoints", "Waypoints", 0, "", ""],
  ];
  // The few that say whether the pictures will do, each with what it means.
  const QUALITY = [
    ["coverage_inspected_pct", "Inspected surface shown", "Share of the surface the expert inspected that this plan shows at least as near, as frontally and as sharply."],
    ["inspected_unattainable_pct", "Cannot be shown", "No safe viewpoint shows this share as well as the expert did."],
    ["inspected_without_counterpart_pct", "No counterpart", "This share of the inspected surface does not exist on this structure."],
    ["gsd_mm_p50", "Resolution, median", "Size of a pixel on the surface in the best picture of each patch; half of the patches are better."],
    ["gsd_mm_p95", "Resolution, worst 5 %", "Only 5 % of the patches are coarser than this."],
    ["pan_fast_pct", "Time with motion blur", "Share of the flight in which the picture moves too fast to be sharp."],
    ["incidence_p95_deg", "Most oblique views", "95 % of the views are more frontal than this; 0° is straight on."],
    ["min_clearance_m", "Minimum clearance", "Smallest distance of the path from the structure."],
  ].map(([key, label, meaning]) => [key, label, ...RESEARCH.find(([name]) => name === key).slice(2, 4), meaning]);
  const CHARTS = [["speed", "Speed, m/s"], ["clearance", "Clearance, m"], ["standoff", "Distance to the surface in the picture, m"]];
  const AXIS = { zeroline: false, automargin: true };

  upplied.pages.transfer = function (app, data) {
    const demonstration = data.demonstration;
    const plan = data.plans[0];
    const tracks = data.plans.filter((each) => each.path).map((each) => ({
      name: each.preset, colour: COLOURS[each.preset] || COLOURS.recommended, path: upplied.path(each.path),
      viewpoints: viewpoints(upplied.unpack(each.viewpoints)), states: each.states ? upplied.unpack(each.states) : null,
    }));
    tracks.push(...data.plans.filter((each) => each.flown).map((each) => ({
      name: each.preset + ", flown", colour: COLOURS.flown, path: upplied.path(each.flown.path), viewpoints: [],
      states: each.flown.states ? upplied.unpack(each.flown.states) : null, width: 3, proof: each.flown.kind === "flown",
    })));
    document.title = demonstration.id + " → " + data.target;
    const panels = ["Fly", "Quality", "Research"].map((name) => element("section", { class: name.toLowerCase() }));
    const fly = plan.path ? upplied.fly(data, plan, tracks[0]) : null;
    let quality = null;
    const tabs = upplied.tabs([["Fly", panels[0], () => setTimeout(() => fly && fly.redraw())],
      ["Quality", panels[1], async () => { if (tracks.length) { await upplied.load("plotly.min.js"); quality = showViews(panels[1], data, plan, tracks); } }],
      ["Research", panels[2]]]);
    const about = upplied.link("demonstrations", demonstration.id), structure = upplied.link("structures", data.target);
    upplied.fill(app,
      element("header", { class: "page" },
        element("a", { class: "back", href: upplied.home }, "All plans"),
        element("h1", {}, demonstration.id, element("span", { class: "arrow" }, " → "), structure ? element("a", { href: structure }, data.target) : data.target, " ", badge(plan.status)),
        element("p", { class: "sub" }, upplied.words(data.kind) + ", demonstrated on " + data.source + (demonstration.operator ? " by " + demonstration.operator : "") + (demonstration.site ? ", " + demonstration.site : "") + ". ",
          plan.decided ? element("span", { class: "decided" }, element("b", {}, "Status: "), plan.decided + ".") : null)),
      upplied.verdicts([plan, ...data.plans.filter((each) => each.preset === "newer draft")]),
      data.plans.filter((each) => each.overruled && each.overruled.length).map((each) => element("section", { class: "verdict not-flyable" },
        element("h2", {}, each.preset + ": safety rules were overruled"), element("ul", {}, each.overruled.map((rule) => element("li", {}, rule))))),
      data.change ? element("p", { class: "note" }, data.change.startsWith("newer draft") ? data.change : "Change since the previous plan: " + data.change) : null,
      tabs.bar, panels);
    upplied.fill(panels[0], fly ? fly.root : element("p", { class: "note" }, "There is no path to fly."), (data.zones || []).length ? element("section", { class: "zones" }, element("h2", {}, "Required zones"), upplied.zones(data.zones)) : null,
      upplied.downloads(data, tracks), upplied.live ? upplied.decisions({ id: plan.provenance.transfer_id, known: plan.known }) : null);
    upplied.fill(panels[1], data.plans.filter((each) => each.flown).map((each) => element("section", { class: "flown" },
      element("h2", {}, each.preset + (each.flown.kind === "flown" ? ", as flown" : ", flown in simulation")), element("p", {}, each.flown.summary))), figures(plan), counterparts(plan));
    upplied.fill(panels[2], upplied.verdicts(data.plans).slice(1), measures(data.plans), remarks(data, about));
    tabs.show(0);
    app.setAttribute("data-ready", "true");
    return () => { if (fly) fly.leave(); if (quality) quality(); app.removeAttribute("data-drawn"); app.removeAttribute("data-ready"); };
  };

  // Two 3-D views that fly together, and what happens along the paths; returns how to leave them.
  function showViews(panel, data, main, planned) {
    const app = document.getElementById("app"), demonstration = data.demonstration;
    const flown = upplied.path(demonstration.path);
    const panes = [data.source, data.target].map((name, at) => element("div", { class: "canvas", tabindex: 0, role: "img",
      "aria-label": (at ? "planned for " : "demonstrated on ") + name + ". Arrow keys turn the view, plus and minus zoom, Home resets." }));
    const readouts = [0, 1].map(() => element("p", { class: "readout" }));
    const charts = element("div", { class: "charts", id: "charts" });
    const slider = element("input", { type: "range", id: "time", min: 0, max: 1000, value: 0, step: 1, "aria-label": "Position in the flight" });
    const clock = element("output", { class: "clock", for: "time" });
    const play = element("button", { type: "button", id: "play" }, "Play");
    const aboard = element("input", { type: "checkbox", id: "aboard" });
    const frusta = element("input", { type: "checkbox", id: "frusta", checked: true });
    const toggles = planned.map((track, at) => element("input", { type: "checkbox", id: "show-" + track.name.replace(", ", "-"), checked: at === 0 || track.name === "newer draft" || track.name === planned[0].name + ", flown" }));
    const colourBy = element("select", { id: "colour-by", "aria-label": "Colours of the surface" },
      element("option", { value: "" }, "plain"),
      planned.map((track, at) => (track.states ? element("option", { value: at, selected: at === 0 }, "views of " + track.name) : null)),
      (data.quality || []).map((each, at) => element("option", { value: "quality " + at }, each.name + " of " + main.preset)));

    const shades = new Set(); // states that some view shows
    for (const each of [...planned.map((track) => track.states), demonstration.states && upplied.unpack(demonstration.states)]) (each || []).forEach((code) => shades.add(code));
    const content = element("div", { class: "player" },
      data.picture ? element("img", { class: "printed", src: data.picture, loading: "lazy", alt: "demonstrated on " + data.source + ", planned for " + data.target }) : null,
      element("div", { class: "flight" }, play, slider, clock,
        element("label", { class: "check" }, aboard, "camera preview"),
        element("label", { class: "check" }, frusta, "viewpoints"),
        planned.some((track) => track.states) ? colourBy : null,
        element("button", { type: "button", id: "save-picture", onclick: () => upplied.picture(data.pair, panes) }, "Picture (PNG)")),
      element("section", { class: "views" },
        element("figure", {}, element("figcaption", {}, line(COLOURS.demonstration), "demonstrated on " + data.source), panes[0], readouts[0]),
        element("figure", { class: "planned" }, element("figcaption", {}, "planned for " + data.target, planned.map((track, at) => element("label", { class: "check" }, toggles[at], line(track.colour), track.name))), panes[1], readouts[1])),
      shades.size ? element("p", { class: "legend" }, STATES.filter((_, code) => shades.has(code)).map(([name, colour]) => element("span", { class: "check" }, swatch(colour), name))) : null,
      charts);
    panel.prepend(content);

    if (!upplied.draws3d()) {
      for (const each of content.querySelectorAll(".views, .flight, .legend")) each.hidden = true;
      const picture = content.querySelector(".printed");
      if (picture) picture.classList.add("instead");
      content.querySelector(".views").after(element("p", { class: "note", id: "no-3d" }, "This browser draws no 3-D views because WebGL is off. " + (picture ? "The picture shows the same." : "The figures below are complete.")));
      drawCharts(charts, [{ name: "demonstrated", colour: COLOURS.demonstration, path: flown }, ...planned], main.safety_m).then(() => app.setAttribute("data-drawn", "true"));
      return () => Plotly.purge(charts);
    }
    const left = upplied.scene(panes[0], upplied.structures[data.source], demonstration.camera,
      [{ name: "demonstrated", colour: COLOURS.demonstration, path: flown, viewpoints: every(flown, 60), states: demonstration.states ? upplied.unpack(demonstration.states) : null }]);
    const right = upplied.scene(panes[1], upplied.structures[data.target], demonstration.camera, planned);
    const drawn = drawCharts(charts, [{ name: "demonstrated", colour: COLOURS.demonstration, path: flown }, ...planned], main.safety_m);

    const print = () => [left, right].forEach((scene, at) => {
      const shot = scene.shot();
      panes[at].querySelectorAll(".shot").forEach((each) => each.remove());
      if (shot) panes[at].append(element("img", { class: "shot", src: shot, alt: panes[at].getAttribute("aria-label").split(".")[0] }));
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
    colourBy.addEventListener("change", () => colourBy.value.startsWith("quality") ? right.measured(data.quality[Number(colourBy.value.slice(8))]) : right.coloured(colourBy.value === "" ? new Uint8Array(upplied.unpack(upplied.structures[data.target].triangles).length / 3) : planned[colourBy.value].states));
    Promise.all([left.ready, right.ready, drawn]).then(() => { repaint(); if (proof > 0) { colourBy.value = proof; colourBy.dispatchEvent(new Event("change")); } return fly(); }).then(() => app.setAttribute("data-drawn", "true"));
    return () => { stop(); window.removeEventListener("beforeprint", print); left.purge(); right.purge(); Plotly.purge(charts); };
  };

  function reading(pose) {
    return pose.time.toFixed(1) + " s · " + format(pose.speed, 1, " m/s") + " · clearance " + format(pose.clearance, 1, " m") + " · surface in picture at " + format(pose.standoff, 1, " m");
  }
  const line = (colour) => upplied.mark("line", colour), swatch = (colour) => upplied.mark("swatch", colour);

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
      ...(plan.flown ? [{ name: plan.preset + ", flown", colour: COLOURS.flown, status: plan.flown.kind === "flown" ? "" : "in simulation", values: { ...plan.flown.measures, margin: margin(plan, plan.flown.measures) } }] : []),
    ]);
    const rows = RESEARCH.filter(([key]) => columns.some(({ values }) => Number.isFinite(values[key])));
    return element("section", {}, element("h2", {}, "All measures"), upplied.table("All measures",
      ["Measure", ...columns.map(({ name, colour, status }) => [line(colour || "#888888"), name + " ", status])],
      [...rows.map(([key, label, digits, unit, help]) => [element("span", { title: help || null }, label), ...columns.map(({ values }) => format(values[key], digits, unit))])], true));
  }

  function figures(plan) {
    const rows = QUALITY.filter(([key]) => Number.isFinite(plan.measures[key]));
    return rows.length ? element("section", { class: "explained" }, element("h2", {}, "Main figures"),
      upplied.table("Main figures", ["Figure", "Value", "Meaning"], rows.map(([key, label, digits, unit, help]) => [label, format(plan.measures[key], digits, unit), help]))) : null;
  }

  // Which parts of this structure correspond to the inspected ones, in words, and how certain that is.
  function counterparts(plan) {
    if (!plan.parts.length) return null;
    return element("section", { class: "counterparts" }, element("h2", {}, "Part matching"),
      upplied.table("Part matching", ["Inspected part", "Confidence", "Share of the inspection", "Similar parts on target", "Flown", "Not flown"],
        plan.parts.map((one) => [one.part, element("span", { class: "certainty " + one.certainty }, one.probability), one.inspected, one.similar || "none", one.flown || "none", one.left_out || "none"])),
      plan.parts.filter((one) => one.doubt).map((one) => element("p", { class: "note" }, one.part + ": " + one.doubt)));
  }

  function margin(plan, values) {
    return plan.safety_m && Number.isFinite(values.min_clearance_m) ? values.min_clearance_m - plan.safety_m : null;
  }

  function remarks(data, about) {
    const demonstration = data.demonstration, passport = demonstration.passport || "not checked";
    return element("section", {}, element("h2", {}, "Provenance"),
      upplied.facts([["Demonstration", demonstration.id + ", " + demonstration.poses + " poses"], ["Import checks", about ? element("a", { href: about }, passport) : passport],
        ["Source", upplied.structures[data.source].findings], ["Target", upplied.structures[data.target].findings], ["Notes", demonstration.notes],
        ["Inspected surface", demonstration.about || "inferred from the flight"]]),
      data.plans.map((plan) => element("details", { open: plan === data.plans[0] }, element("summary", {}, plan.preset),
        upplied.facts([["Counterparts", plan.counterparts], ["Parts labelled by", plan.told_by], ["Stand-off", plan.standoff], ["Match", plan.evidence], ...Object.entries(plan.provenance).map(([name, value]) => [name.replaceAll("_", " "), value])]))));
  }
})();
