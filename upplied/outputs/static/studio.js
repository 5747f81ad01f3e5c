// The studio: one plan, changed viewpoint by viewpoint, checked by the program at every change. All text enters as text.
"use strict";

(async function () {
  const { element, fill, format, unpack, COLOURS, STATES } = upplied;
  const app = document.getElementById("app");
  const STEPS = [0.1, 0.25, 0.5, 1, 2], TURNS = [1, 2, 5, 10];
  const MOVES = [ // what the keys of the list do: forward, left, up, in steps; heading, pitch, in turns
    ["w", "Nearer", [1, 0, 0, 0, 0]], ["s", "Farther", [-1, 0, 0, 0, 0]], ["a", "Left", [0, 1, 0, 0, 0]], ["d", "Right", [0, -1, 0, 0, 0]],
    ["r", "Up", [0, 0, 1, 0, 0]], ["f", "Down", [0, 0, -1, 0, 0]], ["q", "Turn left", [0, 0, 0, 1, 0]], ["e", "Turn right", [0, 0, 0, -1, 0]],
    ["t", "Tilt up", [0, 0, 0, 0, 1]], ["g", "Tilt down", [0, 0, 0, 0, -1]],
  ];
  const FIELDS = [["x_m", "x, m"], ["y_m", "y, m"], ["z_m", "z, m"], ["yaw_deg", "heading, °"], ["pitch_deg", "pitch, °"]];
  const POINTS = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];

  const id = JSON.parse(document.getElementById("data").textContent).plan;
  const ask = (what, request) => upplied.ask("/studio/" + id + "/" + what, request);
  const stage = document.getElementById("stage");
  const began = performance.now();
  const watching = setInterval(async () => {
    const answer = await ask("progress");
    stage.textContent = (answer.stage || "Opening the plan") + " … " + ((performance.now() - began) / 1000).toFixed(0) + " s";
  }, 700);
  const plan = await ask("plan");
  clearInterval(watching);
  if (plan.refused) { app.replaceChildren(element("p", { class: "verdict failed", role: "alert" }, plan.refused)); return; }
  const compass = Number.isFinite(plan.heading_deg);
  // Compass headings are clockwise from true north, the plan's yaw counter-clockwise from +X; each becomes the other by this.
  const turned = (angle) => (compass ? (((plan.heading_deg - angle) % 360) + 360) % 360 : angle);
  document.title = "Studio: " + plan.demonstration + " → " + plan.target;

  // The changes so far; every step can be undone.
  let state = { base: 0, viewpoints: plan.viewpoints.map((each) => ({ ...each })), deleted: [], fixed: [], boxes: [], clearance_m: plan.usual_m };
  let chosen = 0, busy = false, unkept = false, draft = plan.id, number = 0, asking = false, following = null, again = false, held = null;
  const past = [], future = [];
  const changes = () => JSON.stringify(state);
  function change(alter) {
    if (busy) return;
    const before = changes();
    alter(state);
    if (changes() === before) return;
    past.push(before); future.length = 0; unkept = true;
    shown(); judge();
  }
  function back(from, to) {
    if (busy || !from.length) return;
    to.push(changes());
    state = JSON.parse(from.pop());
    chosen = Math.min(chosen, state.viewpoints.length - 1);
    unkept = true;
    shown(); judge();
  }
  const wanted = () => ({ base: state.base, viewpoints: state.viewpoints.filter((_, at) => !state.deleted.includes(at)), fixed: state.fixed,
    keep_out: state.boxes.map((box) => [box.slice(0, 3), box.slice(3)]), clearance_m: state.clearance_m });

  // --- the page ---------------------------------------------------------------------------------
  const verdict = element("section", { class: "verdict", id: "verdict", "aria-live": "polite" });
  const message = element("p", { class: "message", id: "message", role: "status" });
  const pane = element("div", { class: "canvas", id: "view", tabindex: 0, role: "img", "aria-label": "the plan round " + plan.target + ". Arrow keys turn the view, plus and minus zoom, Home resets." });
  const picture = element("div", { class: "canvas", id: "picture", role: "img", "aria-label": "the picture of the camera at the selected viewpoint" });
  const list = element("div", { class: "viewpoints", id: "viewpoints", role: "listbox", tabindex: 0, "aria-label": "Viewpoints in the order of flight", "aria-describedby": "keys" });
  const labelled = (label, input) => element("label", { class: "field" }, element("span", {}, label), input);
  const numeric = (id, value, step) => element("input", { type: "number", id, step, value });
  const button = (id, label, onclick, key) => element("button", { type: "button", id, onclick, "aria-keyshortcuts": key || null }, label + (key ? " (" + key + ")" : ""));
  const step = element("select", { id: "step" }, STEPS.map((each) => element("option", { value: each, selected: each === 0.25 }, each + " m")));
  const looks = element("select", { id: "looks" }, [["follow", "from behind the viewpoint"], ["free", "free"]].map(([value, label]) => element("option", { value }, label)));
  const turn = element("select", { id: "turn" }, TURNS.map((each) => element("option", { value: each, selected: each === 2 }, each + "°")));
  const fields = FIELDS.map(([name, label]) => [name, label, numeric("at-" + name, 0, 0.01)]);
  fields.forEach(([name, , input]) => input.addEventListener("change", () => { if (input.value !== "" && Number.isFinite(Number(input.value))) change((now) => { now.viewpoints[chosen][name] = name === "yaw_deg" ? turned(Number(input.value)) : Number(input.value); }); }));
  const boxes = element("div", { id: "boxes" });
  const clearance = numeric("clearance", plan.usual_m, 0.1);
  clearance.min = plan.usual_m;
  clearance.addEventListener("change", () => change((now) => { now.clearance_m = Math.max(plan.usual_m, Number(clearance.value) || plan.usual_m); }));
  const figures = element("div", { id: "figures" });
  const zones = element("div", { id: "zones" });
  const by = element("input", { type: "text", id: "by", autocomplete: "name", required: true });
  const note = element("input", { type: "text", id: "note" });
  const zone = { name: element("input", { type: "text", id: "zone-name" }), set: element("input", { type: "text", id: "zone-set", value: "inspection" }), where: element("textarea", { id: "zone-where", rows: 2 }),
    radius: numeric("zone-radius", 1, 0.1), gsd_mm: numeric("zone-gsd", "", 0.1), incidence_deg: numeric("zone-incidence", "", 1), looks: numeric("zone-looks", "", 1), max_age_days: numeric("zone-age", "", 1) };
  const paint = element("input", { type: "checkbox", id: "paint" });
  const group = (title, ...children) => element("fieldset", {}, element("legend", {}, title), ...children);

  app.replaceChildren();
  fill(app,
    element("nav", { "aria-label": "Pages" }, element("a", { href: "/index.html" }, "All plans"), " · ", element("a", { href: "/transfers/" + plan.pair + ".html" }, "Page of this plan")),
    element("h1", {}, plan.demonstration + " → " + plan.target), element("p", { class: "sub" }, "Plan " + plan.id + (plan.state ? ". Status: " + plan.state : "") + "."),
    verdict, message,
    element("div", { class: "studio" },
      element("div", { class: "drawn" }, pane, picture,
        element("p", { class: "legend" }, [["as changed", COLOURS.recommended], ["as opened", COLOURS.baseline], ...(plan.in_force ? [["in force", COLOURS.demonstration]] : []), ["a zone", "#b000b0"]].map(([name, colour]) => element("span", { class: "check" }, upplied.mark("swatch", colour), name)),
          STATES.slice(0, 5).map(([name, colour]) => element("span", { class: "check" }, upplied.mark("swatch", colour), name))), figures),
      element("div", { class: "tools-column" },
        group("Viewpoints", list,
          element("p", { class: "note", id: "keys" }, "Click a viewpoint in the view to select it, and drag it by its dot. Up and down select in this list; W A S D R F move, Q E T G turn, Delete removes or restores, X fixes, P paints a zone, Ctrl+Z undoes."),
          element("div", { class: "fields" }, fields.map(([, label, input]) => labelled(label, input))),
          element("div", { class: "fields" }, labelled("step", step), labelled("turn", turn), labelled("view", looks)),
          element("div", { class: "buttons" }, MOVES.map(([key, label, by]) => button("move-" + key, label, () => move(by), key.toUpperCase()))),
          element("div", { class: "buttons" }, button("leave", "Remove or restore", leave, "Delete"), button("fix", "Fix or unfix", fix, "X"), button("undo", "Undo", () => back(past, future), "Control+Z"), button("redo", "Redo", () => back(future, past), "Control+Y"))),
        group("Airspace", labelled("clearance limit, m", clearance), boxes,
          element("div", { class: "buttons" }, button("forbid", "Add a keep-out box here", forbid)), element("p", { class: "note" }, "Each box has two corners, in metres, in the structure's frame.")),
        group("Plan again", element("div", { class: "buttons" }, button("replan", "Plan the other viewpoints again", replan)), element("p", { class: "note" }, "Changed and fixed viewpoints stay. The others are planned for the airspace above.")),
        group("Decide", element("div", { class: "fields" }, labelled("your name", by), labelled("note", note)),
          element("div", { class: "buttons" }, button("keep", "Store as draft", keep), button("reviewed", "Mark as reviewed", () => decide("reviewed")), button("release", "Release", () => decide("released")), button("reject", "Reject", () => decide("rejected")))),
        group("Required zones", zones, element("details", {}, element("summary", {}, "Require another zone"),
          element("div", { class: "fields" }, labelled("name", zone.name), labelled("set", zone.set), labelled("largest pixel, mm", zone.gsd_mm), labelled("largest incidence, °", zone.incidence_deg), labelled("fewest pictures", zone.looks), labelled("largest age, days", zone.max_age_days)),
          labelled("place: landmarks, part_0, box X Y Z X Y Z or ball X Y Z R, separated by commas", zone.where),
          element("div", { class: "fields" }, labelled("radius of the brush, m", zone.radius), element("label", { class: "check" }, paint, "paint by clicking on the surface")),
          element("div", { class: "buttons" }, button("brush", "Paint at the camera's aim", brush, "P"), button("preview", "Show", preview), button("require", "Require this zone", require)))))));

  const opened = upplied.path(plan.path);
  const tracks = [{ name: "as changed", colour: COLOURS.recommended, path: opened, viewpoints: poses(), states: plan.states ? unpack(plan.states) : null },
    { name: "as opened", colour: COLOURS.baseline, path: opened, viewpoints: [], width: 2 }];
  if (plan.in_force) tracks.push({ name: "in force", colour: COLOURS.demonstration, path: upplied.path(plan.in_force.path), viewpoints: [], width: 3 });
  const draws = upplied.draws3d();
  const reach = Math.max(5, 0.15 * Math.max(...plan.structure.size_m));
  const scene = draws ? upplied.scene(pane, plan.structure, plan.camera, tracks, reach) : null;
  const eye = draws ? upplied.scene(picture, plan.structure, plan.camera, [], reach) : null;
  if (scene) { await Promise.all([scene.ready, eye.ready]); for (let at = 1; at < tracks.length; at++) await scene.point(at, null); }
  else picture.remove(), pane.replaceChildren(element("p", { class: "note", id: "no-3d" }, "This browser draws no 3-D views because WebGL is off. Everything else works."));
  paint.addEventListener("change", () => scene && scene.clicks(paint.checked, (place) => ball(place.map((value, at) => value + plan.structure.origin[at]))));
  if (scene) {
    const moved = (at, place) => ({ ...state.viewpoints[at], ...Object.fromEntries(["x_m", "y_m", "z_m"].map((name, axis) => [name, Number((place[axis] + plan.structure.origin[axis]).toFixed(3))])) });
    scene.drags({ places: () => state.viewpoints.map((view) => pose(view).xyz), held: (at) => at === chosen && !busy,
      moved: (at, place) => follow(moved(at, place)), dropped: (at, place) => change((now) => { now.viewpoints[at] = moved(at, place); }), clicked: (at) => { if (!paint.checked) choose(at); } });
  }
  shown(); await tell(plan);
  ask("zones").then((answer) => answer.zones && !unkept && showZones(answer.zones));
  app.setAttribute("data-ready", "true");
  window.addEventListener("beforeunload", (event) => { if (unkept) event.preventDefault(); });
  list.addEventListener("keydown", keyed);
  looks.addEventListener("change", () => follow());
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.target.matches("input, textarea")) return;
    if (event.key.toLowerCase() === "z") { event.preventDefault(); back(past, future); }
    if (event.key.toLowerCase() === "y") { event.preventDefault(); back(future, past); }
  });

  // --- what is shown ----------------------------------------------------------------------------
  function poses() {
    return state.viewpoints.filter((_, at) => !state.deleted.includes(at)).map(pose);
  }
  function pose(view) {
    const [yaw, pitch] = [view.yaw_deg, view.pitch_deg].map((each) => (each * Math.PI) / 360);
    const [a, b, c, d] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    return { xyz: ["x_m", "y_m", "z_m"].map((name, at) => view[name] - plan.structure.origin[at]), quat: [b * d, -a * d, b * c, a * c] };
  }
  // A viewpoint by its number, height and where its camera looks.
  function named(view, at) {
    const angle = turned(view.yaw_deg);
    const heading = compass ? POINTS[Math.round(angle / 45) % 8] + " " + String(Math.round(angle) % 360).padStart(3, "0") + "°" : "yaw " + angle.toFixed(0) + "°";
    return "V" + at + " · z " + view.z_m.toFixed(1) + " m · looks " + heading + ", " + (view.pitch_deg < -1 ? "down " : view.pitch_deg > 1 ? "up " : "level ") + Math.abs(view.pitch_deg).toFixed(0) + "°";
  }
  // Numbers of viewpoints by pass: another begins where the flight turns back on itself, or has been once round.
  function passes() {
    const groups = [[]];
    let ahead = null, round = 0;
    state.viewpoints.forEach((view, at) => {
      if (at) {
        const before = state.viewpoints[at - 1];
        const step = ["x_m", "y_m", "z_m"].map((name) => view[name] - before[name]);
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
  function shown() {
    const rows = state.viewpoints.map((view, at) => {
      const marks = [state.deleted.includes(at) ? "removed" : "", state.fixed.includes(at) ? "fixed" : ""].filter(Boolean).join(", ");
      return element("div", { role: "option", id: "viewpoint-" + at, "aria-selected": String(at === chosen), class: state.deleted.includes(at) ? "out" : "", onclick: () => { choose(at); list.focus(); } },
        named(view, at) + (marks ? " · " + marks : ""));
    });
    list.replaceChildren(...passes().map((own, at) => element("div", { role: "group", "aria-label": "Pass " + (at + 1) },
      element("div", { class: "pass", "aria-hidden": "true" }, passName(own, at)), own.map((each) => rows[each]))));
    choose(chosen);
    clearance.value = state.clearance_m;
    boxes.replaceChildren(...state.boxes.map((box, at) => element("div", { class: "box" },
      box.map((value, k) => { const input = numeric("box-" + at + "-" + k, value, 0.1); input.setAttribute("aria-label", "box " + (at + 1) + ", " + (k < 3 ? "first" : "second") + " corner, " + "xyz"[k % 3] + ", m");
        input.addEventListener("change", () => { if (input.value !== "") change((now) => { now.boxes[at][k] = Number(input.value); }); }); return input; }),
      button("allow-" + at, "Remove the box", () => change((now) => { now.boxes.splice(at, 1); })))));
    drawBoxes();
  }
  function choose(at) {
    chosen = at;
    for (const row of list.querySelectorAll("[role=option]")) row.setAttribute("aria-selected", String(row.id === "viewpoint-" + at));
    list.setAttribute("aria-activedescendant", "viewpoint-" + at);
    const row = document.getElementById("viewpoint-" + at);
    if (row) list.scrollTop = Math.max(Math.min(list.scrollTop, row.offsetTop - list.offsetTop), row.offsetTop + row.offsetHeight - list.offsetTop - list.clientHeight);
    for (const [name, , input] of fields) if (document.activeElement !== input) input.value = Number((name === "yaw_deg" ? turned(state.viewpoints[at][name]) : state.viewpoints[at][name]).toFixed(name.endsWith("deg") ? 2 : 3));
    follow();
  }
  // One drawing at a time: the last viewpoint that was chosen counts.
  function follow(dragged) {
    if (!scene) return;
    again = true; held = dragged;
    if (following) return;
    following = (async () => {
      while (again) {
        again = false;
        const taken = held, at = pose(taken || state.viewpoints[chosen]);
        await scene.point(0, at);
        await scene.overlay("handle", { x: [at.xyz[0]], y: [at.xyz[1]], z: [at.xyz[2]] }, { mode: "markers", marker: { size: 6, color: upplied.colour("--red") } });
        if (looks.value !== "free" && !taken) await scene.face(at, false);
        await eye.face(at, true);
      }
      following = null;
    })();
  }
  function drawBoxes() {
    if (!scene) return;
    const line = { x: [], y: [], z: [] };
    const every = [...plan.declared_boxes.map((box) => box.flat()), ...state.boxes];
    for (const box of every) {
      const [low, high] = [box.slice(0, 3), box.slice(3)].map((corner) => corner.map((value, at) => value - plan.structure.origin[at]));
      const at = (code) => [0, 1, 2].map((axis) => ((code >> axis) & 1 ? high[axis] : low[axis]));
      for (const code of [0, 1, 3, 2, 0, 4, 5, 7, 6, 4, null, 1, 5, null, 3, 7, null, 2, 6, null]) ["x", "y", "z"].forEach((name, axis) => line[name].push(code === null ? null : at(code)[axis]));
    }
    if (!every.length) for (const name of ["x", "y", "z"]) line[name].push(null);
    scene.overlay("boxes", line, { mode: "lines", line: { color: upplied.colour("--red"), width: 4 } });
  }

  // One question at a time, and only the answer to the last one counts.
  async function judge() {
    number++;
    verdict.setAttribute("aria-busy", "true");
    if (asking) return;
    asking = true;
    let own, answer, began;
    do {
      own = number;
      began = performance.now();
      answer = await ask("judge", wanted());
    } while (own !== number);
    asking = false;
    answer.took_ms = performance.now() - began;
    await tell(answer);
  }
  async function tell(answer) {
    verdict.removeAttribute("aria-busy");
    if (answer.refused) {
      verdict.className = "verdict not-flyable";
      verdict.replaceChildren(element("h2", {}, "As changed, the plan cannot be flown"), element("p", {}, answer.refused));
      verdict.setAttribute("data-judged", String(number));
      return;
    }
    const { flyable, headline, look } = answer.verdict;
    verdict.className = "verdict" + (flyable ? "" : " not-flyable");
    verdict.replaceChildren();
    fill(verdict, element("h2", {}, (answer.words ? "As changed, the plan is " : "As opened, the plan is ") + (flyable ? "flyable" : "not flyable")), element("p", {}, headline),
      answer.words ? element("p", {}, "Changes: " + answer.words + ".") : null, look.length ? element("ul", {}, look.map((each) => element("li", {}, each))) : null,
      Number.isFinite(answer.judged_s) ? element("p", { class: "note", id: "judged" }, "Checked in " + format(answer.judged_s, 2, " s") + ".") : null);
    figures.replaceChildren(element("p", { class: "differences" }, answer.differences.map((each) => element("span", {}, each))));
    if (answer.zones) showZones(answer.zones);
    if (scene) {
      await scene.redraw(0, upplied.path(answer.path), poses());
      if (answer.states) await Promise.all([scene, eye].map((each) => each.coloured(unpack(answer.states))));
    }
    verdict.setAttribute("data-judged", String(number));
  }

  function showZones(rows) {
    zones.replaceChildren(rows.length ? element("ul", {}, rows.map((each) => element("li", {}, element("b", {}, each.zone + ": " + each.status), " " + format(each.pct, 1, " % shown") + (each.why ? ", " + each.why : "")))) : element("p", { class: "note" }, "No zones are required."));
  }

  // --- what is done -----------------------------------------------------------------------------
  function keyed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const going = { ArrowDown: chosen + 1, ArrowUp: chosen - 1, Home: 0, End: state.viewpoints.length - 1 };
    const known = MOVES.find(([each]) => each === key);
    if (key in going) choose(Math.min(Math.max(going[key], 0), state.viewpoints.length - 1));
    else if (known) move(known[2]);
    else if (key === "Delete" || key === "Backspace") leave();
    else if (key === "x") fix();
    else if (key === "p") brush();
    else return;
    event.preventDefault();
  }
  // Along where the camera looks, seen from above; nearer is towards what it looks at.
  function move([ahead, left, up, yaw, pitch]) {
    change((now) => {
      const view = now.viewpoints[chosen], far = Number(step.value), angle = Number(turn.value);
      const heading = (view.yaw_deg * Math.PI) / 180, tilt = (view.pitch_deg * Math.PI) / 180;
      const along = [Math.cos(heading) * Math.cos(tilt), Math.sin(heading) * Math.cos(tilt), Math.sin(tilt)];
      const aside = [-Math.sin(heading), Math.cos(heading), 0];
      ["x_m", "y_m", "z_m"].forEach((name, at) => { view[name] = Number((view[name] + far * (ahead * along[at] + left * aside[at] + (at === 2 ? up : 0))).toFixed(4)); });
      view.yaw_deg = Number((view.yaw_deg + yaw * angle).toFixed(4));
      view.pitch_deg = Math.min(90, Math.max(-90, Number((view.pitch_deg + pitch * angle).toFixed(4))));
    });
  }
  const toggle = (list, at) => (list.includes(at) ? list.filter((each) => each !== at) : [...list, at].sort((a, b) => a - b));
  function leave() { change((now) => { now.deleted = toggle(now.deleted, chosen); }); }
  function fix() { change((now) => { now.fixed = toggle(now.fixed, chosen); }); }
  function forbid() {
    const view = state.viewpoints[chosen];
    const middle = ["x_m", "y_m", "z_m"].map((name) => view[name]);
    change((now) => { now.boxes.push([...middle.map((value) => Number((value - 1).toFixed(2))), ...middle.map((value) => Number((value + 1).toFixed(2)))]); });
  }
  async function working(words, what, request) {
    if (busy) return { refused: "" };
    busy = true;
    app.setAttribute("aria-busy", "true");
    message.textContent = words + " …";
    const answer = await ask(what, request);
    busy = false;
    app.removeAttribute("aria-busy");
    message.textContent = answer.refused || answer.message || "";
    message.classList.toggle("refused", Boolean(answer.refused));
    return answer;
  }
  async function replan() {
    const answer = await working("Planning the other viewpoints; this takes as long as planning", "replan", wanted());
    if (answer.refused !== undefined) return;
    past.push(changes()); future.length = 0; unkept = true;
    state = { ...state, base: answer.base, viewpoints: answer.viewpoints, deleted: answer.deleted, fixed: answer.fixed };
    chosen = 0; number++;
    message.textContent = "Planned again round " + answer.fixed.length + " fixed viewpoints.";
    shown(); await tell(answer);
  }
  function signed(request) {
    if (by.value.trim()) return { ...request, by: by.value.trim(), note: note.value };
    message.textContent = "Enter your name first."; message.classList.add("refused"); by.focus();
    return null;
  }
  async function keep() {
    const request = signed(wanted());
    const answer = request && await working("Storing the draft", "keep", request);
    if (answer && answer.id) { draft = answer.id; unkept = false; }
  }
  async function decide(decision) {
    if (unkept && decision !== "rejected") { message.textContent = "Store the change as a draft first, or undo it."; message.classList.add("refused"); return; }
    const request = signed({ decision, id: draft });
    if (request) await working("Storing", "decide", request);
  }
  async function ball(place) {
    const [name, radius] = [zone.where.value.trim(), Number(zone.radius.value) || 1];
    zone.where.value = (name ? name + ", " : "") + "ball " + place.map((value) => Number(value).toFixed(2)).join(" ") + " " + radius;
    await preview();
  }
  async function brush() {
    const answer = await working("Looking", "aim", state.viewpoints[chosen]);
    if (answer.place) { zone.where.closest("details").open = true; await ball(answer.place); }
    else if (!answer.refused) message.textContent = "The camera of this viewpoint looks past the structure.";
  }
  async function preview() {
    const answer = await working("Looking", "zone", { where: zone.where.value });
    if (answer.refused !== undefined) return;
    message.textContent = "The zone is " + format(answer.share_pct, 1, " %") + " of the surface.";
    const points = unpack(answer.points), line = { x: [], y: [], z: [] };
    for (let i = 0; i < points.length; i += 3) ["x", "y", "z"].forEach((name, at) => line[name].push(points[i + at]));
    if (scene) await scene.overlay("zone", line, { mode: "markers", marker: { size: 3, color: "#b000b0" } });
  }
  async function require() {
    const required = { zone: zone.name.value.trim(), where: zone.where.value.trim() };
    for (const name of ["gsd_mm", "incidence_deg", "looks", "max_age_days"]) if (zone[name].value !== "") required[name] = Number(zone[name].value);
    const request = signed({ set: zone.set.value.trim(), zone: required });
    const answer = request && await working("Storing", "require", request);
    if (answer && answer.message && !answer.refused) judge();
  }
})();
