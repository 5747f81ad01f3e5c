// The studio: one plan, changed viewpoint by viewpoint, checked by the program at every change. All text enters as text.
"use strict";

upplied.pages.studio = async function (app, id) {
  const { button, element, entry, field, fill, format, list: listed, note, unpack, COLOURS, STATES } = upplied;
  const STEPS = [0.1, 0.25, 0.5, 1, 2], TURNS = [1, 2, 5, 10];
  const [MOVES, FIELDS, QUALITY] = ["moves", "pose", "zone_limits"].map((table) => Object.entries(upplied.labels[table]).map(([name, row]) => [name, ...row]));
  const PLACE = ["x_m", "y_m", "z_m"];
  const POINTS = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
  const EDGES = [0, 1, 3, 2, 0, 4, 5, 7, 6, 4, null, 1, 5, null, 3, 7, null, 2, 6, null]; // of a box; a bit of each corner for each axis
  const ZONE = "#b000b0";

  const ask = (what, request) => upplied.ask("/studio/" + id + "/" + what, request);
  const stage = element("p", { role: "status" }, "Opening the plan"), began = performance.now();
  app.append(stage);
  const watching = setInterval(async () => {
    const answer = await ask("progress");
    stage.textContent = (answer.stage || "Opening the plan") + " … " + ((performance.now() - began) / 1000).toFixed(0) + " s";
  }, 700);
  const [plan] = await Promise.all([ask("plan"), upplied.load("plotly.min.js")]);
  clearInterval(watching);
  if (plan.refused) { app.replaceChildren(element("p", { class: "verdict failed", role: "alert" }, plan.refused)); return; }
  const compass = Number.isFinite(plan.heading_deg);
  // Compass headings are clockwise from true north, the plan's yaw counter-clockwise from +X; each becomes the other by this.
  const turned = (angle) => (compass ? (((plan.heading_deg - angle) % 360) + 360) % 360 : angle);
  const outside = (place) => place.map((value, axis) => value + plan.structure.origin[axis]); // from the drawn to the structure's own frame
  const drawnAt = (place) => place.map((value, axis) => value - plan.structure.origin[axis]);
  const placeOf = (view) => PLACE.map((name) => view[name]);
  const rounded = (value, digits) => Number(Number(value).toFixed(digits));
  document.title = "Studio: " + plan.demonstration + " → " + plan.target;

  // The changes so far; every step can be undone.
  let state = { base: 0, viewpoints: plan.viewpoints.map((each) => ({ ...each })), deleted: [], fixed: [], boxes: [], clearance_m: plan.usual_m };
  let chosen = 0, busy = false, stored = true, draft = plan.id, number = 0, version = 0;
  const versions = [JSON.stringify(state)];
  function remember() {
    versions.splice(++version, Infinity, JSON.stringify(state));
    stored = false;
  }
  function change(alter) {
    if (busy) return;
    alter(state);
    if (JSON.stringify(state) === versions[version]) return;
    remember();
    show(); judge();
  }
  function travel(by) {
    if (busy || !(version + by in versions)) return;
    state = JSON.parse(versions[version += by]);
    chosen = Math.min(chosen, state.viewpoints.length - 1);
    stored = false;
    show(); judge();
  }
  const undo = () => travel(-1), redo = () => travel(1);
  const remaining = () => state.viewpoints.filter((_, at) => !state.deleted.includes(at));
  const changed = () => ({ base: state.base, viewpoints: remaining(), fixed: state.fixed,
    keep_out: state.boxes.map((box) => [box.slice(0, 3), box.slice(3)]), clearance_m: state.clearance_m });

  // --- the page ---------------------------------------------------------------------------------
  const verdict = element("section", { class: "verdict", id: "verdict", "aria-live": "polite" });
  const signature = upplied.signature();
  const pane = upplied.pane("the plan round " + plan.target, "view");
  const picture = element("div", { class: "canvas", id: "picture", role: "img", "aria-label": "the picture of the camera at the selected viewpoint" });
  const list = element("select", { class: "viewpoints", id: "viewpoints", size: 10, "aria-label": "Viewpoints in the order of flight", "aria-describedby": "keys", onchange: () => choose(Number(list.value)) });
  // A field for a number; `set` takes each that is one.
  const numeric = (id, value, step, set) => element("input", { type: "number", id, step, value, onchange: ({ target }) => {
    if (set && target.value !== "" && Number.isFinite(Number(target.value))) change((now) => set(now, Number(target.value)));
  } });
  const text = (id, value = "") => element("input", { type: "text", id, value });
  const select = (id, options, selected) => element("select", { id }, options.map(([value, label]) => element("option", { value, selected: value === selected }, label)));
  const buttons = (...each) => element("div", { class: "buttons" }, each);
  const fields = (...each) => element("div", { class: "fields" }, each);
  const keyed = (id, label, act, key) => { const made = button(id, label + " (" + key + ")", act); made.setAttribute("aria-keyshortcuts", key); return made; };
  const group = (title, ...children) => element("fieldset", {}, element("legend", {}, title), ...children);
  const looks = select("looks", [["follow", "from behind the viewpoint"], ["free", "free"]]);
  const step = select("step", STEPS.map((each) => [each, each + " m"]), 0.25), turn = select("turn", TURNS.map((each) => [each, each + "°"]), 2);
  const coordinates = FIELDS.map(([name, label]) => [name, label, numeric("at-" + name, 0, 0.01, (now, value) => { now.viewpoints[chosen][name] = name === "yaw_deg" ? turned(value) : value; })]);
  const boxes = element("div", { id: "boxes" });
  const clearance = numeric("clearance", plan.usual_m, 0.1, (now, value) => { now.clearance_m = Math.max(plan.usual_m, value); });
  clearance.min = plan.usual_m;
  const figures = element("div", { id: "figures" }), zones = element("div", { id: "zones" });
  const zone = { name: text("zone-name"), set: text("zone-set", "inspection"), where: element("textarea", { id: "zone-where", rows: 2 }), radius: numeric("zone-radius", 1, 0.1) };
  const quality = QUALITY.map(([name, label, step]) => [name, label, numeric("zone-" + name, "", step)]);
  const paint = element("input", { type: "checkbox", id: "paint" });
  const legend = [["as changed", COLOURS.recommended], ["as opened", COLOURS.baseline], ...(plan.in_force ? [["in force", COLOURS.demonstration]] : []), ["a zone", ZONE], ...STATES.slice(0, 5)];

  app.replaceChildren();
  fill(app,
    element("nav", { "aria-label": "Pages" }, element("a", { href: upplied.home }, "All plans"), " · ", element("a", { href: upplied.link("transfers", plan.pair) }, "Page of this plan")),
    element("h1", {}, plan.demonstration + " → " + plan.target), element("p", { class: "sub" }, "Plan " + plan.id + (plan.state ? ". Status: " + plan.state : "") + "."),
    verdict, signature.message,
    element("div", { class: "studio" },
      element("div", { class: "drawn" }, pane, picture, element("p", { class: "legend" }, legend.map(([name, colour]) => entry(name, "swatch", colour))), figures),
      element("div", { class: "tools-column" },
        group("Viewpoints", list,
          note("Click a viewpoint in the view to select it, and drag it by its dot. Up and down select in this list; W A S D R F move, Q E T G turn, Delete removes or restores, X fixes, P paints a zone, Ctrl+Z undoes.", "keys"),
          fields(coordinates.map(([, label, input]) => field(label, input))),
          fields(field("step", step), field("turn", turn), field("view", looks)),
          buttons(MOVES.map(([key, label, by]) => keyed("move-" + key, label, () => move(by), key.toUpperCase()))),
          buttons(keyed("leave", "Remove or restore", () => toggle("deleted"), "Delete"), keyed("fix", "Fix or unfix", () => toggle("fixed"), "X"), keyed("undo", "Undo", undo, "Control+Z"), keyed("redo", "Redo", redo, "Control+Y"))),
        group("Airspace", field("clearance limit (m)", clearance), boxes, buttons(button("forbid", "Add a keep-out box here", forbid)), note("Each box has two corners, in metres, in the structure's frame.")),
        group("Plan again", buttons(button("replan", "Plan the other viewpoints again", replan)), note("Changed and fixed viewpoints stay. The others are planned for the airspace above.")),
        group("Decide", signature.fields,
          buttons(button("keep", "Store as draft", keep), button("reviewed", "Mark as reviewed", () => decide("reviewed")), button("release", "Release", () => decide("released")), button("reject", "Reject", () => decide("rejected")))),
        group("Required zones", zones, element("details", {}, element("summary", {}, "Require another zone"),
          fields(field("name", zone.name), field("set", zone.set), quality.map(([, label, input]) => field(label, input))),
          field("place: landmarks, part_0, box X Y Z X Y Z or ball X Y Z R, separated by commas", zone.where),
          fields(field("radius of the brush (m)", zone.radius), element("label", { class: "check" }, paint, "paint by clicking on the surface")),
          buttons(keyed("brush", "Paint at the camera's aim", brush, "P"), button("preview", "Show", preview), button("require", "Require this zone", require)))))));

  const opened = upplied.path(plan.path);
  const tracks = [{ name: "as changed", colour: COLOURS.recommended, path: opened, viewpoints: remaining().map(pose), states: plan.states ? unpack(plan.states) : null },
    { name: "as opened", colour: COLOURS.baseline, path: opened, viewpoints: [], width: 2 }];
  if (plan.in_force) tracks.push({ name: "in force", colour: COLOURS.demonstration, path: upplied.path(plan.in_force), viewpoints: [], width: 3 });
  const reach = Math.max(5, 0.15 * Math.max(...plan.structure.size_m));
  const [scene, eye] = upplied.draws3d() ? [[pane, tracks], [picture, []]].map(([root, drawn]) => upplied.scene(root, plan.structure, plan.camera, drawn, reach)) : [];
  const follow = upplied.latest(async (dragged) => {
    if (!scene) return;
    const at = pose(dragged || state.viewpoints[chosen]);
    await scene.point(0, at);
    await scene.overlay("handle", [at.xyz], { mode: "markers", marker: { size: 6, color: upplied.colour("--red") } });
    if (looks.value !== "free" && !dragged) await scene.face(at, false);
    await eye.face(at, true);
  });
  const check = upplied.latest(async () => {
    const own = number, answer = await ask("judge", changed());
    if (own === number) await showVerdict(answer);
  });
  if (scene) {
    await Promise.all([scene.ready, eye.ready]);
    for (let at = 1; at < tracks.length; at++) await scene.point(at, null);
    const moved = (at, place) => ({ ...state.viewpoints[at], ...Object.fromEntries(outside(place).map((value, axis) => [PLACE[axis], rounded(value, 3)])) });
    scene.drags({ places: () => state.viewpoints.map((view) => pose(view).xyz), held: (at) => at === chosen && !busy,
      moved: (at, place) => follow(moved(at, place)), dropped: (at, place) => change((now) => { now.viewpoints[at] = moved(at, place); }), clicked: (at) => { if (!paint.checked) choose(at); } });
    paint.addEventListener("change", () => scene.clicks(paint.checked, (place) => ball(outside(place))));
  } else {
    picture.remove();
    pane.replaceChildren(note("This browser draws no 3-D views because WebGL is off. Everything else works.", "no-3d"));
  }
  show(); await showVerdict(plan);
  ask("zones").then((answer) => answer.zones && stored && showZones(answer.zones));
  app.setAttribute("data-ready", "true");
  window.addEventListener("beforeunload", (event) => { if (!stored) event.preventDefault(); });
  list.addEventListener("keydown", pressed);
  looks.addEventListener("change", () => follow());
  document.addEventListener("keydown", (event) => {
    const act = { z: undo, y: redo }[event.key.toLowerCase()];
    if (!act || !(event.ctrlKey || event.metaKey) || event.target.matches("input, textarea")) return;
    event.preventDefault();
    act();
  });

  // --- what is shown ----------------------------------------------------------------------------
  function pose(view) {
    const [yaw, pitch] = [view.yaw_deg, view.pitch_deg].map((each) => (each * Math.PI) / 360);
    const [a, b, c, d] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    return { xyz: drawnAt(placeOf(view)), quat: [b * d, -a * d, b * c, a * c] };
  }
  // A viewpoint by its number, height and where its camera looks.
  function named(view, at) {
    const angle = turned(view.yaw_deg);
    const heading = compass ? POINTS[Math.round(angle / 45) % 8] + " " + String(Math.round(angle) % 360).padStart(3, "0") + "°" : "yaw " + angle.toFixed(0) + "°";
    const marks = [["deleted", "removed"], ["fixed", "fixed"]].filter(([which]) => state[which].includes(at)).map(([, word]) => word).join(", ");
    return "V" + at + " · z " + view.z_m.toFixed(1) + " m · looks " + heading + ", " + (view.pitch_deg < -1 ? "down " : view.pitch_deg > 1 ? "up " : "level ")
      + Math.abs(view.pitch_deg).toFixed(0) + "°" + (marks ? " · " + marks : "");
  }
  // Numbers of viewpoints by pass: another begins where the flight turns back on itself, or has been once round.
  function passes() {
    const groups = [[]];
    let ahead = null, round = 0;
    state.viewpoints.map(placeOf).forEach((place, at, places) => {
      if (at) {
        const step = place.map((value, axis) => value - places[at - 1][axis]);
        const along = ahead ? step.reduce((sum, value, axis) => sum + value * ahead[axis], 0) : 1;
        if (ahead) round += Math.atan2(ahead[0] * step[1] - ahead[1] * step[0], ahead[0] * step[0] + ahead[1] * step[1]);
        if ((along < 0 && groups[groups.length - 1].length > 2) || Math.abs(round) >= 2 * Math.PI) { groups.push([]); ahead = null; round = 0; }
        else ahead = ahead ? ahead.map((value, axis) => 0.5 * value + step[axis]) : step;
      }
      groups[groups.length - 1].push(at);
    });
    return groups;
  }
  function passName(own, at) {
    const heights = own.map((each) => state.viewpoints[each].z_m), [low, high] = [Math.min(...heights), Math.max(...heights)].map((value) => value.toFixed(0));
    return "Pass " + (at + 1) + ": viewpoints " + own[0] + " to " + own[own.length - 1] + ", z " + (low === high ? low : low + " to " + high) + " m";
  }
  function show() {
    list.replaceChildren(...passes().map((own, at) => element("optgroup", { label: passName(own, at) },
      own.map((each) => element("option", { value: each, class: state.deleted.includes(each) ? "out" : null }, named(state.viewpoints[each], each))))));
    choose(chosen);
    clearance.value = state.clearance_m;
    boxes.replaceChildren(...state.boxes.map((box, at) => element("div", { class: "box" }, box.map((value, k) => corner(at, k, value)),
      button("allow-" + at, "Remove the box", () => change((now) => { now.boxes.splice(at, 1); })))));
    drawBoxes();
  }
  function corner(at, k, value) {
    const input = numeric("box-" + at + "-" + k, value, 0.1, (now, value) => { now.boxes[at][k] = value; });
    input.setAttribute("aria-label", "box " + (at + 1) + ", " + (k < 3 ? "first" : "second") + " corner, " + "xyz"[k % 3] + " (m)");
    return input;
  }
  function choose(at) {
    chosen = at;
    list.value = at;
    for (const [name, , input] of coordinates) {
      const value = state.viewpoints[at][name];
      if (document.activeElement !== input) input.value = rounded(name === "yaw_deg" ? turned(value) : value, name.endsWith("deg") ? 2 : 3);
    }
    follow();
  }
  function drawBoxes() {
    if (!scene) return;
    const places = [...plan.declared_boxes.map((box) => box.flat()), ...state.boxes].flatMap((box) => {
      const ends = [drawnAt(box.slice(0, 3)), drawnAt(box.slice(3))];
      return EDGES.map((code) => (code === null ? null : [0, 1, 2].map((axis) => ends[(code >> axis) & 1][axis])));
    });
    scene.overlay("boxes", places.length ? places : [null], { mode: "lines", line: { color: upplied.colour("--red"), width: 4 } });
  }

  function judge() {
    number++;
    verdict.setAttribute("aria-busy", "true");
    check();
  }
  async function showVerdict(answer) {
    const { flyable, headline, look } = answer.verdict || { flyable: false, headline: answer.refused, look: [] };
    const title = answer.refused ? "As changed, the plan cannot be flown" : (answer.words ? "As changed" : "As opened") + ", the plan is " + (flyable ? "flyable" : "not flyable");
    verdict.removeAttribute("aria-busy");
    verdict.className = "verdict" + (flyable ? "" : " not-flyable");
    verdict.replaceChildren();
    fill(verdict, element("h2", {}, title), element("p", {}, headline),
      answer.words ? element("p", {}, "Changes: " + answer.words + ".") : null, listed(look),
      Number.isFinite(answer.judged_s) ? note("Checked in " + format(answer.judged_s, 2, " s") + ".", "judged") : null);
    if (answer.zones) showZones(answer.zones);
    if (!answer.refused) {
      figures.replaceChildren(element("p", { class: "differences" }, ...answer.differences.map((each) => element("span", {}, each))));
      if (scene) await scene.redraw(0, upplied.path(answer.path), remaining().map(pose));
      if (scene && answer.states) await Promise.all([scene, eye].map((each) => each.coloured(unpack(answer.states))));
    }
  }

  function showZones(rows) {
    zones.replaceChildren(listed(rows.map((each) => [element("b", {}, each.zone + ": " + each.status), " " + format(each.pct, 1, " % shown") + (each.why ? ", " + each.why : "")])) || note("No zones are required."));
  }

  // --- what is done -----------------------------------------------------------------------------
  function pressed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, leave = () => toggle("deleted");
    const acts = { Delete: leave, Backspace: leave, x: () => toggle("fixed"), p: brush, ...Object.fromEntries(MOVES.map(([each, , by]) => [each, () => move(by)])) };
    if (!(key in acts)) return;
    acts[key]();
    event.preventDefault();
  }
  // Along where the camera looks, seen from above; nearer is towards what it looks at.
  function move([ahead, left, up, yaw, pitch]) {
    change((now) => {
      const view = now.viewpoints[chosen], far = Number(step.value), angle = Number(turn.value);
      const [heading, tilt] = [view.yaw_deg, view.pitch_deg].map((each) => (each * Math.PI) / 180);
      const along = [Math.cos(heading) * Math.cos(tilt), Math.sin(heading) * Math.cos(tilt), Math.sin(tilt)], aside = [-Math.sin(heading), Math.cos(heading), 0];
      PLACE.forEach((name, at) => { view[name] = rounded(view[name] + far * (ahead * along[at] + left * aside[at] + (at === 2 ? up : 0)), 4); });
      view.yaw_deg = rounded(view.yaw_deg + yaw * angle, 4);
      view.pitch_deg = Math.min(90, Math.max(-90, rounded(view.pitch_deg + pitch * angle, 4)));
    });
  }
  function toggle(which) {
    change((now) => { now[which] = now[which].includes(chosen) ? now[which].filter((each) => each !== chosen) : [...now[which], chosen].sort((a, b) => a - b); });
  }
  function forbid() {
    change((now) => { now.boxes.push([-1, 1].flatMap((side) => placeOf(now.viewpoints[chosen]).map((value) => rounded(value + side, 2)))); });
  }
  async function working(words, what, request) {
    if (busy || !request) return { refused: "" };
    busy = true;
    app.setAttribute("aria-busy", "true");
    signature.show(words + " …");
    const answer = await ask(what, request);
    busy = false;
    app.removeAttribute("aria-busy");
    signature.show(answer.refused || answer.message || "", Boolean(answer.refused));
    return answer;
  }
  async function replan() {
    const answer = await working("Planning the other viewpoints; this takes as long as planning", "replan", changed());
    if (answer.refused !== undefined) return;
    state = { ...state, base: answer.base, viewpoints: answer.viewpoints, deleted: answer.deleted, fixed: answer.fixed };
    remember();
    chosen = 0; number++;
    signature.show("Planned again round " + answer.fixed.length + " fixed viewpoints.");
    show(); await showVerdict(answer);
  }
  async function keep() {
    const answer = await working("Storing the draft", "keep", signature.sign(changed()));
    if (answer.id) { draft = answer.id; stored = true; }
  }
  async function decide(decision) {
    if (!stored && decision !== "rejected") signature.show("Store the change as a draft first, or undo it.", true);
    else await working("Storing", "decide", signature.sign({ decision, id: draft }));
  }
  async function ball(place) {
    zone.where.value = [zone.where.value.trim(), "ball " + place.map((value) => Number(value).toFixed(2)).join(" ") + " " + (Number(zone.radius.value) || 1)].filter(Boolean).join(", ");
    await preview();
  }
  async function brush() {
    const answer = await working("Finding the place in the middle of the picture", "aim", { ...changed(), viewpoint: chosen });
    if (answer.place) { zone.where.closest("details").open = true; await ball(answer.place); }
    else if (answer.refused === undefined) signature.show("The camera of this viewpoint looks past the structure.");
  }
  async function preview() {
    const answer = await working("Drawing the zone", "zone", { where: zone.where.value });
    if (answer.refused !== undefined) return;
    signature.show("The zone is " + format(answer.share_pct, 1, " %") + " of the surface.");
    if (scene) await scene.overlay("zone", upplied.points(unpack(answer.points)), { mode: "markers", marker: { size: 3, color: ZONE } });
  }
  async function require() {
    const required = { zone: zone.name.value.trim(), where: zone.where.value.trim() };
    for (const [name, , input] of quality) if (input.value !== "") required[name] = Number(input.value);
    const answer = await working("Storing", "require", signature.sign({ set: zone.set.value.trim(), zone: required }));
    if (answer.message) judge();
  }
};
