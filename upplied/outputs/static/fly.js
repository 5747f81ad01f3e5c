// What a pilot reads first: a map and the heights of the mission, its time, battery and photos.
"use strict";

(function () {
  const { bounds, element, entry, format, minutes, note, points, tile, unpack } = upplied;
  const SORTIES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"];
  const [TRANSIT, LIMIT, FOOTPRINT, RETURN] = ["#7a7a7a", "#b3261e", "#e69f00", "#d55e00"];
  const STEPS_M = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
  const colourOf = (sortie) => SORTIES[sortie % SORTIES.length];

  upplied.fly = function (data, plan, track) {
    const mission = data.mission || {};
    const flown = mission.sorties ? mission.sorties.map((sortie) => ({ ...sortie, xyz: points(unpack(sortie.xyz)), photo: unpack(sortie.photo), inspect: unpack(sortie.inspect) })) : null;
    const path = points(track.path.xyz), limits = [...(mission.keep_out || []), ...(mission.fence || [])];
    // The parts of each flight, on transit legs or on the inspection.
    const flights = flown ? flown.map(runs) : [[{ inside: true, places: path }]];
    const drawings = [
      ["map", "Map" + (flown ? ", north up" : ", +X of the structure to the right"), (pen) => drawMap(pen, data, mission, flown, flights, track)],
      ["heights", "Heights above " + (mission.home ? "take-off" : "ground") + ", by distance flown", (pen) => drawHeights(pen, mission, flights)],
    ].map(([id, title, draw]) => ({ draw, title, canvas: element("canvas", { id, role: "img", "aria-label": title + " of " + data.target }) }));
    const redraw = () => drawings.forEach(({ canvas, draw }) => draw(sharp(canvas)));
    const scheme = window.matchMedia("(prefers-color-scheme: dark)");
    window.addEventListener("resize", redraw);
    scheme.addEventListener("change", redraw);
    const root = element("div", {},
      mission.refused ? note("No mission can be written yet: " + mission.refused, "no-mission") : null,
      element("div", { class: "drawings" }, drawings.map(({ canvas, title }) => element("figure", {}, element("figcaption", {}, title), canvas))),
      element("p", { class: "legend" }, flown ? [entry("take-off", "home", null, "H"), entry("transit legs", "line", TRANSIT)] : null,
        flights.map((_, at) => entry(flights.length > 1 ? "flight " + (at + 1) : "inspection path", "line", colourOf(at))),
        entry("photo", "photo"), entry("footprint of a photo", "footprint"), limits.length ? entry("keep-out area or geofence", "line", LIMIT) : null),
      tiles(plan, mission, flown), battery(data, mission, flown));
    return { root, redraw, leave() { window.removeEventListener("resize", redraw); scheme.removeEventListener("change", redraw); } };
  };

  function tiles({ measures, safety_m: limit }, mission, flown) {
    const total = flown ? flown.reduce((sum, sortie) => sum + sortie.duration_s, 0) : measures.duration_s;
    const tall = (value, label, digits, help) => tile(format(value, digits, " m"), label, "", help);
    return element("div", { class: "tiles", id: "tiles" },
      tile(minutes(total), flown ? (flown.length > 1 ? flown.length + " flights, take-off to landing" : "take-off to landing") : "inspection time"),
      tall(measures.min_clearance_m, "minimum clearance" + (limit ? " (limit " + limit + " m)" : ""), 1),
      flown ? [
        tile(String(mission.photos), "photos"),
        tile(format(mission.shown_pct, 1, " %"), "inspected surface shown by the photos", "", "No coarser than 1.25 times the finest look of the path"),
        tile(format(mission.interval_s, 1, " s"), "shortest photo interval"),
        tile(upplied.megabytes(mission.storage_mb), "storage" + (mission.assumed_camera ? ", at 20 megapixels" : ""), "", "0.4 MB per megapixel of a JPEG"),
        tall(mission.return_m, "return-to-home height, at least", 0, "Above take-off: an automatic return at this height passes over everything"),
        tall(mission.transit_m, "height of transit legs, above take-off", 1),
        tall(mission.highest_m, "highest point, above take-off", 1),
        tile(mission.home_deg.join(", "), "take-off (latitude, longitude)"),
      ] : tall(measures.path_length_m, "path length", 0));
  }

  // One bar for each flight: the share of a battery that it takes; the reserve is marked.
  function battery({ target }, mission, flown) {
    if (!flown) return null;
    const share = (seconds) => (100 * seconds) / mission.endurance_s;
    if (!mission.endurance_s) return note("Battery not checked: set the endurance of the vehicle (upplied set " + target + " vehicle.endurance_s=SECONDS --by NAME) and plan again.", "battery");
    return element("div", { id: "battery" }, flown.map(({ duration_s: time }, at) => {
      const words = "Flight " + (at + 1) + ": " + minutes(time) + ", " + share(time).toFixed(0) + " % of a battery (limit " + share(mission.usable_s).toFixed(0) + " %)";
      const [taken, reserve] = [element("i", {}), element("u", {})];
      taken.style.width = Math.min(100, share(time)) + "%";
      reserve.style.left = share(mission.usable_s) + "%";
      return element("p", {}, words, element("div", { class: "battery" + (time > mission.usable_s ? " over" : ""), role: "meter",
        "aria-valuemin": 0, "aria-valuemax": 100, "aria-valuenow": share(time).toFixed(0), "aria-label": words }, taken, reserve));
    }));
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

  function trace(pen, corners) {
    corners.forEach(([x, y], at) => (at ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  }
  function line(pen, corners, colour, width) {
    pen.beginPath();
    trace(pen, corners);
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
  }
  function fill(pen, shapes, colour) {
    pen.fillStyle = colour;
    for (const shape of shapes) { pen.beginPath(); trace(pen, shape); pen.fill(); }
  }

  // Consecutive runs of waypoints on transit legs or on the inspection.
  function runs({ xyz, inspect }) {
    const parts = [];
    for (let at = 1; at < xyz.length; at++) {
      const inside = Boolean(inspect[at] && inspect[at - 1]);
      if (!parts.length || parts[parts.length - 1].inside !== inside) parts.push({ inside, places: [xyz[at - 1]] });
      parts[parts.length - 1].places.push(xyz[at]);
    }
    return parts;
  }

  function drawMap(pen, data, mission, flown, flights, track) {
    const turn = Number.isFinite(mission.heading_deg) ? (mission.heading_deg * Math.PI) / 180 : Math.PI / 2;
    const flat = ([x, y]) => [Math.sin(turn) * x - Math.cos(turn) * y, Math.cos(turn) * x + Math.sin(turn) * y];
    const structure = upplied.structures[data.target], vertices = points(unpack(structure.vertices));
    const waypoints = flights.flat().flatMap((run) => run.places), home = mission.home;
    const [[left, right], [bottom, top]] = bounds([...vertices, ...waypoints, ...(home ? [home] : [])].map(flat));
    const scale = Math.min((pen.wide - 48) / Math.max(right - left, 1e-6), (pen.high - 48) / Math.max(top - bottom, 1e-6));
    const at = (place) => { const [x, y] = flat(place); return [pen.wide / 2 + scale * (x - (left + right) / 2), pen.high / 2 - scale * (y - (bottom + top) / 2)]; };
    drawSurface(pen, vertices.map(at), points(unpack(structure.triangles)));
    const views = pictured(flown, track.viewpoints), path = points(track.path.xyz);
    pen.globalAlpha = Math.max(0.05, Math.min(0.3, 6 / Math.max(views.length, 1)));
    fill(pen, views.map(({ xyz, quat }) => hull([xyz, ...upplied.corners(xyz, quat, data.demonstration.camera, track.path.standoff[nearest(path, xyz)])].map(at))), FOOTPRINT);
    pen.globalAlpha = 1;
    const areas = (mission.keep_out || []).map(([[x, y], [u, v]]) => [[x, y], [u, y], [u, v], [x, v]]);
    for (const area of [...areas, mission.fence || []]) line(pen, [...area, ...area.slice(0, 1)].map(at), LIMIT, 2);
    flights.forEach((sortie, k) => {
      if (home) line(pen, [home, sortie[0].places[0]].map(at), TRANSIT, 1.5);
      for (const run of sortie) line(pen, run.places.map(at), run.inside ? colourOf(k) : TRANSIT, run.inside ? 2.5 : 1.5);
    });
    pen.fillStyle = pen.ink;
    for (const [x, y] of photos(flown).map(at)) { pen.beginPath(); pen.arc(x, y, 2, 0, 7); pen.fill(); }
    if (home) { const [x, y] = at(home); pen.fillRect(x - 5, y - 5, 10, 10); pen.fillText("H", x + 9, y + 4); }
    const metres = STEPS_M.filter((each) => each * scale < pen.wide / 4).pop() || STEPS_M[0];
    line(pen, [[12, pen.high - 10], [12 + metres * scale, pen.high - 10]], pen.ink, 3);
    pen.fillText(metres + " m", 12, pen.high - 16);
    if (flown) { line(pen, [[18, 44], [18, 14]], pen.ink, 2); line(pen, [[13, 22], [18, 12], [23, 22]], pen.ink, 2); pen.fillText("N", 14, 58); }
  }

  // Surfaces seen from above and from below apart: drawn as one, they would cancel each other out.
  function drawSurface(pen, places, triangles) {
    pen.fillStyle = pen.skin;
    for (const side of [1, -1]) {
      pen.beginPath();
      for (const triangle of triangles) {
        const corners = Array.from(triangle, (corner) => places[corner]);
        if (side * across(...corners) > 0) trace(pen, corners);
      }
      pen.fill();
    }
    if (!triangles.length) for (const [x, y] of places) pen.fillRect(x, y, 1.5, 1.5);
  }

  const photos = (flown) => (flown || []).flatMap((sortie) => sortie.xyz.filter((_, at) => sortie.photo[at]));

  // The viewpoints at which a mission takes its photos; all of them where none is written.
  function pictured(flown, viewpoints) {
    const taken = photos(flown), places = viewpoints.map((view) => view.xyz);
    return taken.length && places.length ? [...new Set(taken.map((place) => viewpoints[nearest(places, place)]))] : viewpoints;
  }

  // Twice the area of the triangle of three points; negative where they turn the other way.
  const across = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);

  // The corners of the smallest convex area round some points, in order: along its lower side, and back.
  function hull(corners) {
    const side = (sorted) => sorted.reduce((chain, corner) => {
      while (chain.length > 1 && across(chain[chain.length - 2], chain[chain.length - 1], corner) <= 0) chain.pop();
      return [...chain, corner];
    }, []);
    const sorted = [...corners].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    return [...side(sorted), ...side(sorted.reverse())];
  }

  // The number of the place that is nearest to another.
  function nearest(places, [x, y, z]) {
    let best = Infinity, which = 0;
    places.forEach((place, at) => {
      const far = (place[0] - x) ** 2 + (place[1] - y) ** 2 + (place[2] - z) ** 2;
      if (far < best) { best = far; which = at; }
    });
    return which;
  }

  // Round values from low to high, at most so many steps apart.
  function ticks(low, high, most) {
    const step = STEPS_M.find((each) => high - low <= most * each) || STEPS_M[STEPS_M.length - 1];
    const first = Math.ceil(low / step - 1e-6);
    return Array.from({ length: Math.max(0, Math.floor(high / step + 1e-6) - first + 1) }, (_, at) => (first + at) * step);
  }

  function drawHeights(pen, mission, flights) {
    const places = flights.flat().flatMap((run) => run.places), height = (place) => place[2];
    const ground = Number.isFinite(mission.ground) ? mission.ground : Math.min(...places.map(height));
    const zero = mission.home ? mission.home[2] : ground;
    const levels = [["ground", ground, pen.faint], ["ceiling", mission.ceiling, LIMIT], ["return to home", zero + (mission.return_m ?? NaN), RETURN]].filter(([, z]) => Number.isFinite(z));
    const [[low, high]] = bounds([...places.map(height), ...levels.map(([, z]) => z)].map((z) => [z]));
    let total = 0;
    const drawn = flights.map((sortie) => sortie.map((run) => run.places.map((place, i) => {
      if (i) total += Math.hypot(...[0, 1, 2].map((axis) => place[axis] - run.places[i - 1][axis]));
      return [total, place[2]];
    })));
    const at = ([x, z]) => [52 + ((pen.wide - 66) * x) / Math.max(total, 1e-6), pen.high - 34 - ((pen.high - 60) * (z - low)) / Math.max(high - low, 1e-6)];
    pen.fillStyle = pen.faint;
    for (const [name, z, colour] of levels) {
      line(pen, [[0, z], [total, z]].map(at), colour, 1);
      pen.fillText(name + " " + (z - zero).toFixed(0) + " m", pen.wide - 150, at([0, z])[1] - 4);
    }
    drawn.forEach((sortie, k) => {
      const [start] = sortie[0], end = sortie[sortie.length - 1].slice(-1)[0];
      if (mission.home) for (const [x, z] of [start, end]) line(pen, [[x, zero], [x, z]].map(at), TRANSIT, 2);
      sortie.forEach((run, i) => line(pen, run.map(at), flights[k][i].inside ? colourOf(k) : TRANSIT, 2));
    });
    for (const each of ticks(low - zero, high - zero, 5)) pen.fillText(each + " m", 8, at([0, zero + each])[1] + 4);
    for (const far of ticks(0, total, pen.wide < 420 ? 3 : 6)) {
      const half = pen.measureText(far + " m").width / 2;
      pen.fillText(far + " m", Math.min(at([far, low])[0] - half, pen.wide - 4 - 2 * half), pen.high - 14);
    }
  }
})();
