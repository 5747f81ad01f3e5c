// A plan's page in three tabs: what a pilot flies, what the pictures will show, and every figure for research.
"use strict";

(function () {
  const { element, entry, fill, badge, format, list, mark, note, section, table, unpack, COLOURS, STATES } = upplied;
  const CHARTS = [["speed", "Speed (m/s)"], ["clearance", "Clearance (m)"], ["standoff", "Distance to the surface in the picture (m)"]];
  const AXIS = { zeroline: false, automargin: true };
  const NEWER = "newer draft";

  upplied.pages.transfer = function (app, data) {
    const { demonstration, plans, target } = data, plan = plans[0], proofs = plans.filter((each) => each.flown);
    const states = (packed) => (packed ? unpack(packed) : null);
    const tracks = [
      ...plans.filter((each) => each.path).map((each) => ({ name: each.preset, colour: COLOURS[each.preset] || COLOURS.recommended,
        path: upplied.path(each.path), viewpoints: viewpoints(unpack(each.viewpoints)), states: states(each.states) })),
      ...proofs.map(({ preset, flown }) => ({ name: preset + ", flown", colour: COLOURS.flown, width: 3, proof: flown.kind === "flown",
        path: upplied.path(flown.path), viewpoints: [], states: states(flown.states) }))];
    document.title = demonstration.id + " → " + target;
    const fly = plan.path ? upplied.fly(data, plan) : null;
    let leaveViews = () => {};
    const openViews = async () => {
      await upplied.load("plotly.min.js");
      leaveViews = showViews(panels[1], data, plan, tracks);
    };
    const { bar, panels, show } = upplied.tabs([["Fly", null], ["Quality", tracks.length ? openViews : null], ["Research", null]]);
    const about = upplied.link("demonstrations", demonstration.id), structure = upplied.link("structures", target);
    fill(app,
      element("header", { class: "page" },
        element("a", { class: "back", href: upplied.home }, "All plans"),
        element("h1", {}, demonstration.id, element("span", { class: "arrow" }, " → "), structure ? element("a", { href: structure }, target) : target, " ", badge(plan.status)),
        element("p", { class: "sub" }, upplied.words(data.kind) + ", demonstrated on " + data.source
          + (demonstration.operator ? " by " + demonstration.operator : "") + (demonstration.site ? ", " + demonstration.site : "") + ". ",
        plan.decided ? element("span", {}, element("b", {}, "Status: "), plan.decided + ".") : null)),
      upplied.verdicts([plan, ...plans.filter((each) => each.preset === NEWER)]),
      plans.filter((each) => (each.overruled || []).length).map((each) => element("section", { class: "verdict not-flyable" },
        element("h2", {}, each.preset + ": safety rules were overruled"), list(each.overruled))),
      data.change ? note(data.change.startsWith(NEWER) ? data.change : "Change since the previous plan: " + data.change) : null,
      bar, panels);
    fill(panels[0], fly || note("There is no path to fly."),
      (data.zones || []).length ? section("Required zones", upplied.zones(data.zones)) : null,
      upplied.downloads(data), upplied.live ? upplied.decisions({ id: plan.provenance.transfer_id, known: plan.known }) : null);
    fill(panels[1], proofs.map(({ preset, flown }) => element("section", { class: "flown" },
      element("h2", {}, preset + (flown.kind === "flown" ? ", as flown" : ", flown in simulation")), element("p", {}, flown.summary))), figures(plan), counterparts(plan));
    fill(panels[2], upplied.verdicts(plans).slice(1), measures(plans), provenance(data, about));
    show(0);
    app.setAttribute("data-ready", "true");
    return () => {
      leaveViews();
      for (const name of ["data-drawn", "data-ready"]) app.removeAttribute(name);
    };
  };

  // Two 3-D views that fly together, and what happens along the paths; returns how to leave them.
  function showViews(panel, data, main, planned) {
    const app = document.getElementById("app"), { demonstration } = data;
    const flown = { name: "demonstrated", colour: COLOURS.demonstration, path: upplied.path(demonstration.path), states: demonstration.states ? unpack(demonstration.states) : null };
    flown.viewpoints = every(flown.path, 60);
    const panes = [data.source, data.target].map((name, at) => upplied.pane((at ? "planned for " : "demonstrated on ") + name));
    const readouts = [0, 1].map(() => element("p", { class: "readout" }));
    const charts = element("div", { class: "charts", id: "charts" });
    const slider = element("input", { type: "range", id: "time", min: 0, max: 1000, value: 0, step: 1, "aria-label": "Position in the flight" });
    const clock = element("output", { class: "clock", for: "time" });
    const play = element("button", { type: "button", id: "play" }, "Play");
    const checkbox = (id, checked) => element("input", { type: "checkbox", id, checked });
    const check = (input, ...label) => element("label", { class: "check" }, input, label);
    const aboard = checkbox("aboard", false), frusta = checkbox("frusta", true);
    const toggles = planned.map(({ name }, at) => checkbox("show-" + name.replace(", ", "-"), at === 0 || name === NEWER || name === planned[0].name + ", flown"));
    const colourings = [["plain", () => right.coloured(null)],
      ...planned.filter((track) => track.states).map((track) => ["views of " + track.name, () => right.coloured(track.states), track]),
      ...(data.quality || []).map((each) => [each.name + " of " + main.preset, () => right.measured(each)])];
    const proof = colourings.findIndex(([, , track]) => track && track.proof); // what was truly flown and seen comes first
    const colourBy = element("select", { id: "colour-by", "aria-label": "Colours of the surface" },
      colourings.map(([name], at) => element("option", { value: at, selected: at === (proof < 0 ? 1 : proof) }, name)));

    const shades = new Set([flown, ...planned].flatMap((track) => [...(track.states || [])])); // states that some view shows
    const line = (colour) => mark("line", colour);
    const content = element("div", { class: "player" },
      data.picture ? element("img", { class: "printed", src: data.picture, loading: "lazy", alt: "demonstrated on " + data.source + ", planned for " + data.target }) : null,
      element("div", { class: "flight" }, play, slider, clock, check(aboard, "camera preview"), check(frusta, "viewpoints"),
        colourings.some(([, , track]) => track) ? colourBy : null,
        element("button", { type: "button", id: "save-picture", onclick: () => upplied.picture(data.pair, panes) }, "Picture (PNG)")),
      element("section", { class: "views" },
        element("figure", {}, element("figcaption", {}, line(flown.colour), "demonstrated on " + data.source), panes[0], readouts[0]),
        element("figure", { class: "planned" }, element("figcaption", {}, "planned for " + data.target,
          planned.map((track, at) => check(toggles[at], line(track.colour), track.name))), panes[1], readouts[1])),
      shades.size ? element("p", { class: "legend" }, STATES.filter((_, code) => shades.has(code)).map(([name, colour]) => entry(name, "swatch", colour))) : null,
      charts);
    panel.prepend(content);
    const ready = () => app.setAttribute("data-drawn", "true");
    const drawn = drawCharts(charts, [flown, ...planned], main.safety_m);

    if (!upplied.draws3d()) {
      for (const each of content.querySelectorAll(".views, .flight, .legend")) each.hidden = true;
      const picture = content.querySelector(".printed");
      if (picture) picture.classList.add("instead");
      content.querySelector(".views").after(note("This browser draws no 3-D views because WebGL is off. " + (picture ? "The picture shows the same." : "The figures below are complete."), "no-3d"));
      drawn.then(ready);
      return () => Plotly.purge(charts);
    }
    const left = upplied.scene(panes[0], upplied.structures[data.source], demonstration.camera, [flown]);
    const right = upplied.scene(panes[1], upplied.structures[data.target], demonstration.camera, planned);

    const print = () => [left, right].forEach((scene, at) => {
      const shot = scene.shot();
      panes[at].querySelectorAll(".shot").forEach((each) => each.remove());
      if (shot) panes[at].append(element("img", { class: "shot", src: shot, alt: panes[at].getAttribute("aria-label").split(".")[0] }));
    });
    window.addEventListener("beforeprint", print);

    let timer = null;
    const fly = upplied.latest(async () => {
      const share = slider.value / 1000;
      const first = Math.max(0, toggles.findIndex((toggle) => toggle.checked));
      const [one, many] = [await left.fly(share, aboard.checked, 0), await right.fly(share, aboard.checked, first)];
      readouts[0].textContent = reading(one[0]);
      readouts[1].textContent = reading(many[first]);
      clock.textContent = (100 * share).toFixed(0) + " %";
      await drawn;
      await Plotly.relayout(charts, { "shapes[0].x0": 100 * share, "shapes[0].x1": 100 * share });
    });
    function stop() { clearInterval(timer); timer = null; play.textContent = "Play"; }
    slider.addEventListener("input", fly);
    play.addEventListener("click", () => {
      if (timer) { stop(); return; }
      if (Number(slider.value) >= 1000) slider.value = 0;
      play.textContent = "Pause";
      const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches; // somebody wants less motion
      const [step, wait] = still ? [50, 1000] : [3, 60];
      timer = setInterval(() => { slider.value = Number(slider.value) + step; fly(); if (Number(slider.value) >= 1000) stop(); }, wait);
    });
    aboard.addEventListener("change", async () => { if (!aboard.checked) await Promise.all([left.home(), right.home()]); fly(); });
    const repaint = () => { left.visible(0, true, frusta.checked); toggles.forEach((toggle, at) => right.visible(at, toggle.checked, frusta.checked)); };
    [frusta, ...toggles].forEach((input) => input.addEventListener("change", () => { repaint(); fly(); }));
    const colour = () => colourings[colourBy.value][1]();
    colourBy.addEventListener("change", colour);
    Promise.all([left.ready, right.ready, drawn]).then(() => { repaint(); if (proof >= 0) colour(); return fly(); }).then(ready);
    return () => { stop(); window.removeEventListener("beforeprint", print); left.purge(); right.purge(); Plotly.purge(charts); };
  }

  function reading(pose) {
    return pose.time.toFixed(1) + " s · " + format(pose.speed, 1, " m/s") + " · clearance " + format(pose.clearance, 1, " m") + " · surface in picture at " + format(pose.standoff, 1, " m");
  }

  // A path's poses, at most so many, evenly over its time.
  function every(path, most) {
    const count = Math.min(most, path.count);
    return Array.from({ length: count }, (_, at) => path.at(count > 1 ? at / (count - 1) : 0));
  }
  function viewpoints(values) {
    return Array.from({ length: values.length / 7 }, (_, at) => {
      const [x, y, z, ...quat] = values.subarray(7 * at, 7 * at + 7);
      return { xyz: [x, y, z], quat };
    });
  }

  function drawCharts(root, tracks, safety) {
    const height = 0.27, gap = 0.095, ink = upplied.colour("--ink"), axis = { ...AXIS, gridcolor: upplied.colour("--line") };
    const traces = CHARTS.flatMap(([key], row) => tracks.map((track) => ({
      x: Array.from(track.path.t, (time) => (100 * time) / (track.path.duration || 1)),
      y: Array.from(track.path[key], (value) => (Number.isFinite(value) ? value : null)),
      mode: "lines", name: track.name, legendgroup: track.name, showlegend: row === 0, yaxis: "y" + (row ? row + 1 : ""),
      line: { color: track.colour, width: track.name in COLOURS ? 2 : 1.5, dash: { paper: "dash", baseline: "dot" }[track.name] || "solid" },
      hovertemplate: "%{y:.2f}",
    })));
    const upright = (x) => ({ type: "line", xref: "x", yref: "paper", x0: x, x1: x, y0: 0, y1: 1, line: { color: ink, width: 1 } });
    const level = (y) => ({ type: "line", xref: "paper", yref: "y2", x0: 0, x1: 1, y0: y, y1: y, line: { color: "#d55e00", width: 1.5, dash: "dashdot" } });
    const text = { xref: "paper", yref: "paper", xanchor: "left", yanchor: "bottom", showarrow: false };
    const tops = CHARTS.map((_, row) => 1 - row * (height + gap));
    const layout = { height: 500, margin: { l: 50, r: 20, t: 56, b: 40 }, hovermode: "x unified", paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: 12, color: ink }, legend: { orientation: "h", y: 1.06, yanchor: "bottom" },
      xaxis: { ...axis, title: { text: "share of the flight (%)" }, range: [0, 100], anchor: "y3" },
      ...Object.fromEntries(tops.map((top, row) => ["yaxis" + (row ? row + 1 : ""), { ...axis, domain: [Math.max(0, top - height), top], rangemode: "tozero" }])),
      shapes: [upright(0), ...(safety ? [level(safety)] : [])],
      annotations: [...tops.map((y, row) => ({ ...text, text: CHARTS[row][1], x: 0, y })),
        ...(safety ? [{ ...text, text: "safety distance " + safety + " m", x: 1, xanchor: "right", yref: "y2", y: safety, font: { color: upplied.colour("--orange"), size: 11 } }] : [])] };
    return Plotly.newPlot(root, traces, layout, { displaylogo: false, responsive: true, displayModeBar: false });
  }

  // Every measure of each plan, and of its flight.
  function measures(plans) {
    const margin = (plan, values) => (plan.safety_m && Number.isFinite(values.min_clearance_m) ? values.min_clearance_m - plan.safety_m : null);
    const columns = plans.flatMap((plan) => [
      [plan.preset, COLOURS[plan.preset], badge(plan.status), plan.measures],
      ...(plan.flown ? [[plan.preset + ", flown", COLOURS.flown, plan.flown.kind === "flown" ? "" : "in simulation", plan.flown.measures]] : []),
    ].map(([name, colour, status, values]) => [[mark("line", colour || "#888888"), name + " ", status], { ...values, margin: margin(plan, values) }]));
    const rows = Object.entries(upplied.labels.research).filter(([key]) => columns.some(([, values]) => Number.isFinite(values[key])));
    return section("All measures", table("All measures", ["Measure", ...columns.map(([head]) => head)],
      rows.map(([key, [label, digits, unit, help]]) => [element("span", { title: help || null }, label), ...columns.map(([, values]) => format(values[key], digits, unit))]), true));
  }

  // The few figures that say whether the pictures will do.
  function figures({ measures }) {
    const { quality, research } = upplied.labels, shown = Object.entries(quality).filter(([key]) => Number.isFinite(measures[key]));
    const rows = shown.map(([key, [label, meaning]]) => {
      const [, digits, unit] = research[key];
      return [label, format(measures[key], digits, unit), meaning];
    });
    return shown.length ? element("section", { class: "explained" }, element("h2", {}, "Main figures"), table("Main figures", ["Figure", "Value", "Meaning"], rows)) : null;
  }

  // Which parts of this structure correspond to the inspected ones, in words, and how certain that is.
  function counterparts({ parts }) {
    return parts.length ? section("Part matching",
      table("Part matching", ["Inspected part", "Confidence", "Share of the inspection", "Similar parts on target", "Flown", "Not flown"],
        parts.map((one) => [one.part, element("span", { class: "certainty " + one.certainty }, one.probability), one.inspected, ...[one.similar, one.flown, one.left_out].map((text) => text || "none")])),
      parts.filter((one) => one.doubt).map((one) => note(one.part + ": " + one.doubt))) : null;
  }

  function provenance({ demonstration, source, target, plans }, about) {
    const passport = demonstration.passport || "not checked";
    return section("Provenance",
      upplied.facts([["Demonstration", demonstration.id + ", " + demonstration.poses + " poses"], ["Import checks", about ? element("a", { href: about }, passport) : passport],
        ["Source", upplied.structures[source].findings], ["Target", upplied.structures[target].findings], ["Notes", demonstration.notes],
        ["Inspected surface", demonstration.about || "inferred from the flight"]]),
      plans.map((plan, at) => element("details", { open: at === 0 }, element("summary", {}, plan.preset),
        upplied.facts([["Counterparts", plan.counterparts], ["Parts labelled by", plan.told_by], ["Stand-off", plan.standoff], ["Match", plan.evidence],
          ...Object.entries(plan.provenance).map(([name, value]) => [upplied.words(name), value])]))));
  }
})();
