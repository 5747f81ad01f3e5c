// What a pilot reads first: a map and the heights of the mission, its time, battery and photos.
"use strict";

(function () {
  const { element, format, minutes, unpack } = upplied;
  const SORTIES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"];
  const STEPS_M = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

  upplied.fly = function (data, plan, track) {
    const mission = data.mission || {};
    const flown = mission.sorties ? mission.sorties.map((sortie) => ({ ...sortie, xyz: unpack(sortie.xyz), photo: unpack(sortie.photo), inspect: unpack(sortie.inspect) })) : null;
    const drawings = [
      ["map", "Map" + (flown ? ", north up" : ", +X of the structure to the right"), (pen) => drawMap(pen, data, mission, flown, track)],
      ["heights", "Heights above " + (mission.home ? "take-off" : "ground") + ", by distance flown", (pen) => drawHeights(pen, mission, flown, track)],
    ].map(([id, title, draw]) => ({ draw, canvas: element("canvas", { id, role: "img", "aria-label": title + " of " + data.target }), title }));
    const redraw = () => drawings.forEach(({ canvas, draw }) => draw(sharp(canvas)));
    const scheme = window.matchMedia("(prefers-color-scheme: dark)");
    window.addEventListener("resize", redraw);
    scheme.addEventListener("change", redraw);
    const root = element("div", {},
      mission.refused ? element("p", { class: "note", id: "no-mission" }, "No mission can be written yet: " + mission.refused) : null,
      element("div", { class: "drawings" }, drawings.map(({ canvas, title }) => element("figure", {}, element("figcaption", {}, title), canvas))),
      element("p", { class: "legend" }, flown ? [key("H", "take-off"), key("#7a7a7a", "transit legs"), ...flown.map((_, at) => key(SORTIES[at % SORTIES.length], flown.length > 1 ? "flight " + (at + 1) : "inspection path"))] : key(SORTIES[0], "inspection path"),
        key("dot", "photo"), key("area", "footprint of a photo"), (mission.keep_out || []).length || (mission.fence || []).length ? key("#b3261e", "keep-out area or geofence") : null),
      tiles(plan, mission, flown), battery(data, mission, flown));
    return { root, redraw, leave() { window.removeEventListener("resize", redraw); scheme.removeEventListener("change", redraw); } };
  };

  function tiles(plan, mission, flown) {
    const tile = (value, label, help) => element("div", { class: "tile", title: help || null }, element("b", {}, value), element("span", {}, label));
    const measures = plan.measures;
    const total = flown ? flown.reduce((sum, sortie) => sum + sortie.duration_s, 0) : measures.duration_s;
    return element("div", { class: "tiles", id: "tiles" },
      tile(minutes(total), flown ? (flown.length > 1 ? flown.length + " flights, take-off to landing" : "take-off to landing") : "inspection time"),
      tile(format(measures.min_clearance_m, 1, " m"), "minimum clearance" + (plan.safety_m ? " (limit " + plan.safety_m + " m)" : "")),
      flown ? [
        tile(String(mission.photos), "photos"),
        tile(format(mission.shown_pct, 1, " %"), "inspected surface shown by the photos", "No coarser than 1.25 times the finest look of the path"),
        tile(Number.isFinite(mission.interval_s) ? mission.interval_s.toFixed(1) + " s" : "–", "shortest photo interval"),
        tile(upplied.megabytes(mission.storage_mb), "storage" + (mission.assumed_camera ? ", at 20 megapixels" : ""), "0.4 MB per megapixel of a JPEG"),
        tile(format(mission.return_m, 0, " m"), "return-to-home height, at least", "Above take-off: an automatic return at this height passes over everything"),
        tile(format(mission.transit_m, 1, " m"), "height of transit legs, above take-off"),
        tile(format(mission.highest_m, 1, " m"), "highest point, above take-off"),
        tile(mission.home_deg.join(", "), "take-off (latitude, longitude)"),
      ] : tile(format(measures.path_length_m, 0, " m"), "path length"));
  }

  // One bar for each flight: the share of a battery that it takes; the reserve is marked.
  function battery(data, mission, flown) {
    if (!flown) return null;
    if (!mission.endurance_s) return element("p", { class: "note", id: "battery" }, "Battery not checked: set the endurance of the vehicle (upplied set " + data.target + " vehicle.endurance_s=SECONDS --by NAME) and plan again.");
    return element("div", { id: "battery" }, flown.map((sortie, at) => {
      const share = (100 * sortie.duration_s) / mission.endurance_s;
      const words = "Flight " + (at + 1) + ": " + minutes(sortie.duration_s) + ", " + share.toFixed(0) + " % of a battery (limit " + ((100 * mission.usable_s) / mission.endurance_s).toFixed(0) + " %)";
      const bar = element("div", { class: "battery" + (sortie.duration_s > mission.usable_s ? " over" : ""), role: "meter", "aria-valuemin": 0, "aria-valuemax": 100, "aria-valuenow": share.toFixed(0), "aria-label": words }, element("i", {}), element("u", {}));
      bar.children[0].style.width = Math.min(100, share) + "%";
      bar.children[1].style.left = (100 * mission.usable_s) / mission.endurance_s + "%";
      return element("p", {}, words, bar);
    }));
  }

  function key(kind, name) {
    const mark = element("i", { class: kind === "dot" ? "photo" : kind === "area" ? "footprint" : kind === "H" ? "home" : "line" }, kind === "H" ? "H" : "");
    if (kind.startsWith("#")) mark.style.background = kind;
    return element("span", { class: "check" }, mark, name);
  }

  // A canvas as fine as the screen, with its pen; sizes are in CSS pixels.
  function sharp(canvas) {
    const ratio = window.devicePixelRatio || 1, wide = canvas.clientWidth || 600, high = canvas.clientHeight || 320;
    canvas.width = wide * ratio;
    canvas.height = high * ratio;
    // Drawn by the processor: without a graphics card a browser takes seconds for so many shapes.
    const pen = canvas.getContext("2d", { willReadFrequently: true });
    pen.scale(ratio, ratio);
    pen.font = "12px system-ui, sans-serif";
    pen.lineJoin = "round";
    return Object.assign(pen, { wide, high, ink: upplied.colour("--ink"), faint: upplied.colour("--faint"), skin: upplied.colour("--edge") });
  }

  function line(pen, points, colour, width) {
    pen.beginPath();
    points.forEach(([x, y], at) => (at ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
  }

  const rows = (values) => Array.from({ length: values.length / 3 }, (_, at) => values.subarray(3 * at, 3 * at + 3));

  // Consecutive runs of waypoints on transit legs or on the inspection.
  function runs(sortie) {
    const points = rows(sortie.xyz), parts = [];
    for (let at = 1; at < points.length; at++) {
      const inside = Boolean(sortie.inspect[at] && sortie.inspect[at - 1]);
      if (!parts.length || parts[parts.length - 1].inside !== inside) parts.push({ inside, from: at - 1, points: [points[at - 1]] });
      parts[parts.length - 1].points.push(points[at]);
    }
    return parts;
  }

  function drawMap(pen, data, mission, flown, track) {
    const turn = Number.isFinite(mission.heading_deg) ? (mission.heading_deg * Math.PI) / 180 : Math.PI / 2;
    const flat = ([x, y]) => [Math.sin(turn) * x - Math.cos(turn) * y, Math.cos(turn) * x + Math.sin(turn) * y];
    const structure = upplied.structures[data.target];
    const vertices = rows(unpack(structure.vertices)).map(flat);
    const paths = flown ? flown.map((sortie) => rows(sortie.xyz).map(flat)) : [rows(track.path.xyz).map(flat)];
    const home = mission.home ? flat(mission.home) : null;
    let [left, bottom, right, top] = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [x, y] of [...vertices, ...paths.flat(), ...(home ? [home] : [])]) {
      left = Math.min(left, x); right = Math.max(right, x); bottom = Math.min(bottom, y); top = Math.max(top, y);
    }
    const scale = Math.min((pen.wide - 48) / Math.max(right - left, 1e-6), (pen.high - 48) / Math.max(top - bottom, 1e-6));
    const at = ([x, y]) => [pen.wide / 2 + scale * (x - (left + right) / 2), pen.high / 2 - scale * (y - (bottom + top) / 2)];
    pen.fillStyle = pen.skin;
    const triangles = unpack(structure.triangles), places = vertices.map(at);
    // Surfaces seen from above and from below apart: drawn as one, they would cancel each other out.
    for (const side of [1, -1]) {
      pen.beginPath();
      for (let i = 0; i < triangles.length; i += 3) {
        const [a, b, c] = [0, 1, 2].map((k) => places[triangles[i + k]]);
        if (side * across(a, b, c) <= 0) continue;
        pen.moveTo(...a); pen.lineTo(...b); pen.lineTo(...c);
      }
      pen.fill();
    }
    if (!triangles.length) for (const [x, y] of places) pen.fillRect(x, y, 1.5, 1.5);
    const views = pictured(flown, track.viewpoints);
    pen.globalAlpha = Math.max(0.05, Math.min(0.3, 6 / Math.max(views.length, 1)));
    pen.fillStyle = "#e69f00";
    for (const view of views) {
      const shown = upplied.corners(view.xyz, view.quat, data.demonstration.camera, track.path.standoff[nearest(track.path.xyz, view.xyz)]);
      pen.beginPath();
      hull([view.xyz, ...shown].map((corner) => at(flat(corner)))).forEach((corner) => pen.lineTo(...corner));
      pen.fill();
    }
    pen.globalAlpha = 1;
    for (const [low, high] of mission.keep_out || []) line(pen, [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]], [low[0], low[1]]].map((p) => at(flat(p))), "#b3261e", 2);
    if ((mission.fence || []).length) line(pen, [...mission.fence, mission.fence[0]].map((p) => at(flat(p))), "#b3261e", 2);
    if (flown) flown.forEach((sortie, k) => {
      if (home) line(pen, [at(home), at(paths[k][0])], "#7a7a7a", 1.5);
      for (const run of runs(sortie)) line(pen, run.points.map((p) => at(flat(p))), run.inside ? SORTIES[k % SORTIES.length] : "#7a7a7a", run.inside ? 2.5 : 1.5);
      pen.fillStyle = pen.ink;
      rows(sortie.xyz).forEach((point, i) => { if (sortie.photo[i]) { const [x, y] = at(flat(point)); pen.beginPath(); pen.arc(x, y, 2, 0, 7); pen.fill(); } });
    });
    else line(pen, paths[0].map(at), SORTIES[0], 2.5);
    if (home) {
      const [x, y] = at(home);
      pen.fillStyle = pen.ink; pen.fillRect(x - 5, y - 5, 10, 10); pen.fillText("H", x + 9, y + 4);
    }
    const metres = STEPS_M.filter((each) => each * scale < pen.wide / 4).pop() || STEPS_M[0];
    line(pen, [[12, pen.high - 10], [12 + metres * scale, pen.high - 10]], pen.ink, 3);
    pen.fillStyle = pen.ink;
    pen.fillText(metres + " m", 12, pen.high - 16);
    if (flown) { line(pen, [[18, 44], [18, 14]], pen.ink, 2); line(pen, [[13, 22], [18, 12], [23, 22]], pen.ink, 2); pen.fillText("N", 14, 58); }
  }

  // The viewpoints at which a mission takes its photos; all of them where none is written.
  function pictured(flown, viewpoints) {
    const photos = (flown || []).flatMap((sortie) => rows(sortie.xyz).filter((_, at) => sortie.photo[at]));
    if (!photos.length || !viewpoints.length) return viewpoints;
    const places = Float32Array.from(viewpoints.flatMap((view) => view.xyz));
    return [...new Set(photos.map((place) => viewpoints[nearest(places, place)]))];
  }

  // Twice the area of the triangle of three points; negative where they turn the other way.
  const across = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);

  // The corners of the smallest convex area round some points, in order: along its lower side, and back.
  function hull(points) {
    const side = (sorted) => sorted.reduce((line, point) => {
      while (line.length > 1 && across(line[line.length - 2], line[line.length - 1], point) <= 0) line.pop();
      return [...line, point];
    }, []);
    const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    return [...side(sorted), ...side(sorted.reverse())];
  }

  // The number of the place, of x y z each, that is nearest to another.
  function nearest(places, [x, y, z]) {
    let best = Infinity, at = 0;
    for (let i = 0; i < places.length; i += 3) {
      const far = (places[i] - x) ** 2 + (places[i + 1] - y) ** 2 + (places[i + 2] - z) ** 2;
      if (far < best) { best = far; at = i / 3; }
    }
    return at;
  }

  // Round values from low to high, at most so many steps apart.
  function ticks(low, high, most) {
    const step = STEPS_M.find((each) => high - low <= most * each) || STEPS_M[STEPS_M.length - 1];
    const first = Math.ceil(low / step - 1e-6);
    return Array.from({ length: Math.max(0, Math.floor(high / step + 1e-6) - first + 1) }, (_, at) => (first + at) * step);
  }

  function drawHeights(pen, mission, flown, track) {
    const ground = Number.isFinite(mission.ground) ? mission.ground : Math.min(...rows(track.path.xyz).map((point) => point[2]));
    const zero = mission.home ? mission.home[2] : ground;
    const parts = flown ? flown.map(runs) : [[{ inside: true, points: rows(track.path.xyz) }]];
    const levels = [["ground", ground, pen.faint], ...(Number.isFinite(mission.ceiling) ? [["ceiling", mission.ceiling, "#b3261e"]] : []),
      ...(Number.isFinite(mission.return_m) ? [["return to home", zero + mission.return_m, "#d55e00"]] : [])];
    const heights = [...parts.flat(2).flatMap((run) => run.points.map((point) => point[2])), ...levels.map(([, z]) => z)];
    const [low, high] = [Math.min(...heights), Math.max(...heights)];
    let total = 0;
    const drawn = parts.map((sortie) => sortie.map((run) => run.points.map((point, i) => {
      if (i) total += Math.hypot(...[0, 1, 2].map((axis) => point[axis] - run.points[i - 1][axis]));
      return [total, point[2]];
    })));
    const at = ([x, z]) => [52 + ((pen.wide - 66) * x) / Math.max(total, 1e-6), pen.high - 34 - ((pen.high - 60) * (z - low)) / Math.max(high - low, 1e-6)];
    pen.fillStyle = pen.faint;
    for (const [name, z, colour] of levels) {
      line(pen, [at([0, z]), at([total, z])], colour, 1);
      pen.fillText(name + " " + (z - zero).toFixed(0) + " m", pen.wide - 150, at([0, z])[1] - 4);
    }
    if (flown) for (const sortie of drawn) for (const [x, z] of [sortie[0][0], sortie[sortie.length - 1].slice(-1)[0]]) line(pen, [at([x, zero]), at([x, z])], "#7a7a7a", 2);
    drawn.forEach((sortie, k) => sortie.forEach((points, i) => line(pen, points.map(at), parts[k][i].inside ? SORTIES[k % SORTIES.length] : "#7a7a7a", 2)));
    for (const height of ticks(low - zero, high - zero, 5)) pen.fillText(height + " m", 8, at([0, zero + height])[1] + 4);
    for (const far of ticks(0, total, pen.wide < 420 ? 3 : 6)) {
      const half = pen.measureText(far + " m").width / 2;
      pen.fillText(far + " m", Math.min(at([far, low])[0] - half, pen.wide - 4 - 2 * half), pen.high - 14);
    }
  }
})();
