// One 3-D view: a structure, paths, camera frusta, and a camera that flies.
"use strict";

(function () {
  const { element, unpack, points, bounds, STATES } = upplied;
  const FOV = Math.PI / 4; // of the viewer's own eye
  const KEYS = { // what a key does: turns round the vertical and over the top, and steps away
    ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0], "+": [0, 0, -1], "=": [0, 0, -1], "-": [0, 0, 1], Home: [0, 0, 0],
  };

  const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
  const cross = (a, b) => [0, 1, 2].map((k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
  const unit = (v) => v.map((value) => value / (Math.hypot(...v) || 1));
  const plus = (a, b, times = 1) => Array.from(a, (value, axis) => value + times * b[axis]);
  const named = ([x, y, z]) => ({ x, y, z });

  // The element that a view is drawn in.
  upplied.pane = (name, id = null) => element("div", { class: "canvas", id, tabindex: 0, role: "img",
    "aria-label": name + ". Arrow keys turn the view, plus and minus zoom, Home resets." });

  // Points as arrays of x, y and z, one for each axis; null between two of them breaks a line.
  upplied.columns = columns;
  function columns(places) {
    return Object.fromEntries(["x", "y", "z"].map((name, axis) => [name, places.map((place) => place && place[axis])]));
  }

  // A path as arrays, with poses at any share 0 .. 1 of its duration.
  upplied.path = function (data) {
    const path = Object.fromEntries(Object.entries(data).map(([name, packed]) => [name, unpack(packed)]));
    const { t } = path;
    path.count = t.length;
    path.duration = path.count ? t[path.count - 1] : 0;
    path.at = function (share) {
      const time = share * path.duration, after = t.findIndex((each) => each > time);
      const high = after < 0 ? path.count - 1 : after, low = Math.max(0, high - 1);
      const part = t[high] > t[low] ? Math.min(1, Math.max(0, (time - t[low]) / (t[high] - t[low]))) : 0;
      const ends = (values, width) => [low, high].map((at) => Array.from(values.subarray(width * at, width * (at + 1))));
      const mix = (values, width, side = 1) => { const [a, b] = ends(values, width); return a.map((value, at) => value * (1 - part) + side * b[at] * part); };
      const turn = Math.sign(dot(...ends(path.quat, 4))) || 1; // the shorter way round
      const [speed, clearance, standoff] = [path.speed, path.clearance, path.standoff].map((values) => mix(values, 1)[0]);
      return { time, xyz: mix(path.xyz, 3), quat: unit(mix(path.quat, 4, turn)), speed, clearance, standoff };
    };
    return path;
  };

  // The vector v in the camera frame (forward, left, up), turned by the quaternion x y z w.
  function turned([x, y, z, w], v) {
    const axis = [x, y, z], twice = cross(axis, v).map((value) => 2 * value);
    return plus(plus(v, twice, w), cross(axis, twice));
  }

  // The corners of a picture, so far before its camera; tangents are half of its width and height at 1 m.
  const tangents = (camera, most) => [camera.hfov_deg, camera.vfov_deg].map((angle) => Math.tan((Math.min(angle, most) * Math.PI) / 360));
  function corners(xyz, quat, camera, depth) {
    const [across, upward] = tangents(camera, 150);
    return [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([left, up]) => plus(turned(quat, [depth, left * across * depth, up * upward * depth]), xyz));
  }

  // Edges of pyramids as one broken line.
  function pyramids(poses, camera, depth) {
    return columns(poses.flatMap(({ xyz, quat }) => {
      const [a, b, c, d] = corners(xyz, quat, camera, depth);
      return [a, b, c, d, a, xyz, b, null, c, xyz, d, null];
    }));
  }

  // As many of the poses as stand a step apart along the path, evenly chosen.
  function apart(poses, step) {
    const length = poses.reduce((sum, { xyz }, at) => sum + (at ? Math.hypot(...plus(xyz, poses[at - 1].xyz, -1)) : 0), 0);
    const every = Math.max(1, Math.ceil(poses.length / Math.max(2, length / step)));
    return poses.filter((_, at) => at % every === 0);
  }

  // Colours in even steps over a scale, from a share of it to its end.
  const ramp = (colours, from = 0) => colours.map((colour, at) => [from + ((1 - from) * at) / (colours.length - 1), colour]);
  const bar = (text, ticks) => ({ showscale: true, colorbar: { title: { text }, thickness: 12, len: 0.6, ...ticks } });
  const STATE_SCALE = { cmin: -0.5, cmax: STATES.length - 0.5, showscale: false,
    colorscale: STATES.flatMap(([, colour], at) => [[at / STATES.length, colour], [(at + 1) / STATES.length, colour]]) };

  function surface(vertices, triangles, states) {
    const shared = { ...columns(vertices), hoverinfo: "skip", showlegend: false }, codes = states || new Uint8Array(triangles.length || vertices.length);
    if (!triangles.length) return { ...shared, type: "scatter3d", mode: "markers", marker: { size: 2.5, color: codes, ...STATE_SCALE } };
    const { x: i, y: j, z: k } = columns(triangles);
    return { ...shared, type: "mesh3d", i, j, k, intensitymode: "cell", intensity: codes, ...STATE_SCALE, flatshading: true,
      lighting: { ambient: 0.62, diffuse: 0.55, specular: 0.08, roughness: 0.9, fresnel: 0.05, vertexnormalsepsilon: 1e-12, facenormalsepsilon: 1e-12 },
      lightposition: { x: -20000, y: -60000, z: 90000 } };
  }

  // scene(root, structure, camera, tracks): tracks are {name, colour, path, viewpoints, states, width}.
  // `room` is how far beyond them something may come to be drawn, m.
  upplied.scene = function (root, structure, camera, tracks, room = 0) {
    const vertices = points(unpack(structure.vertices)), triangles = points(unpack(structure.triangles));
    const lines = tracks.map((track) => points(track.path.xyz)), first = [...vertices, ...(lines[0] || [])];
    const limits = bounds([...vertices, ...lines.flat()]).map(([low, high]) => [low - room, high + room]);
    const size = limits.map(([low, high]) => Math.max(high - low, 1e-3)), longest = Math.max(...size);
    const centre = (box) => box.map(([low, high]) => (low + high) / 2);
    const middle = centre(limits), focus = centre(bounds(first));
    const inPlot = (place) => plus(place, middle, -1).map((value) => value / longest); // from metres to the plot's units
    const sparse = first.filter((_, at) => at >= vertices.length || at % Math.ceil(vertices.length / 3000) === 0).map((place) => plus(place, focus, -1));

    const shared = { type: "scatter3d", mode: "lines", showlegend: false };
    const small = (poses) => pyramids(apart(poses, 0.07 * longest), camera, 0.045 * longest), large = (poses) => pyramids(poses, camera, 0.1 * longest);
    const traces = [surface(vertices, triangles, tracks.map((track) => track.states).find(Boolean))];
    const groups = tracks.map(({ name, colour, path, viewpoints, width }, at) => {
      const label = Array.from(path.t, (time, i) => name + "<br>" + time.toFixed(1) + " s, clearance " + upplied.format(path.clearance[i], 1, " m"));
      const from = traces.push(
        { ...shared, ...columns(lines[at]), line: { color: colour, width: width || 5 }, text: label, hoverinfo: "text" },
        { ...shared, ...small(viewpoints), line: { color: colour, width: 2 }, opacity: 0.75, hoverinfo: "skip" },
        { ...shared, ...large([path.at(0)]), line: { color: upplied.colour("--ink"), width: 6 }, hoverinfo: "skip" });
      return { line: from - 3, frusta: from - 2, flying: from - 1, shown: [true, true, true] };
    });
    const all = (own) => [own.line, own.frusta, own.flying];
    const home = looking(unit([0.562 * (aside(0) < -0.25 ? -1 : 1), 0.719 * (aside(1) > 0.05 ? 1 : -1), 0.407]));
    const axis = (at) => ({ visible: false, autorange: false, range: limits[at] });
    const layout = {
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, hoverlabel: { font: { size: 12 } },
      scene: { xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual", camera: home, aspectratio: named(size.map((value) => value / longest)) },
    };
    const overlays = {};
    let frame = null;
    const ready = Plotly.newPlot(root, traces, layout, { displaylogo: false, responsive: true, displayModeBar: false, scrollZoom: true });
    const restyle = async (update, which) => { await ready; await Plotly.restyle(root, update, which); };
    const shape = (trace, places) => restyle(Object.fromEntries(Object.entries(places).map(([name, values]) => [name, [values]])), [trace]);
    const look = async (view) => { await ready; await Plotly.relayout(root, { "scene.camera": view }); };
    const paint = (values, scale) => {
      const own = triangles.length ? "" : "marker.", update = { [own ? "marker.color" : "intensity"]: [values] };
      for (const [key, value] of Object.entries(scale)) update[own + key] = [value];
      return restyle(update, [0]);
    };

    root.addEventListener("keydown", (event) => {
      if (!(event.key in KEYS)) return;
      event.preventDefault();
      look(event.key === "Home" ? home : stepped(standing(), KEYS[event.key]));
    });

    return {
      ready, shape,
      async fly(share, aboard, chosen) {
        await ready;
        preview(aboard);
        const poses = tracks.map((track) => track.path.at(share));
        const tips = poses.map((pose) => large(aboard ? [] : [pose]));
        if (tips.length) await restyle(columns(tips.map(({ x, y, z }) => [x, y, z])), groups.map((own) => own.flying));
        if (aboard && poses[chosen]) await look(aboardCamera(poses[chosen]));
        return poses;
      },
      // The view from where a pose is, so far off that all is in view; or as its camera sees.
      async face(pose, aboard) {
        await ready;
        await preview(aboard);
        const [ahead, aside] = unit(plus(pose.xyz, focus, -1).slice(0, 2));
        return look(aboard ? aboardCamera(pose) : looking([0.9 * ahead, 0.9 * aside, 0.436], 1.04));
      },
      // The pointer takes a place, in metres, along in the plane of the screen. `held` tells whether the place number
      // `at` may be taken; `moved` hears of each step, `dropped` of the last; a click near another is `clicked`.
      drags({ places, held, moved, dropped, clicked }) {
        let drag = null, down = null;
        const local = (event) => { const box = root.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
        const far = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
        const nearest = (spot, most, allowed = () => true) => places().map(onScreen).reduce(([best, which], place, at) => {
          const away = place[2] > 0 && allowed(at) ? far(place, spot) : Infinity;
          return away < best ? [away, at] : [best, which];
        }, [most, -1])[1];
        const on = (name, act) => root.addEventListener(name, act, true);
        on("pointerdown", (event) => {
          down = local(event);
          const at = event.button ? -1 : nearest(down, 16, held);
          if (at < 0) return;
          event.preventDefault(); event.stopPropagation();
          root.setPointerCapture(event.pointerId);
          drag = { at, place: places()[at], to: null };
        });
        on("pointermove", (event) => {
          const spot = local(event);
          if (!drag) { const at = event.buttons ? -1 : nearest(spot, 16); root.style.cursor = at < 0 ? "" : held(at) ? "grab" : "pointer"; return; }
          event.stopPropagation();
          drag.to = byScreen(drag.place, spot[0] - down[0], spot[1] - down[1]);
          moved(drag.at, drag.to);
        });
        on("pointerup", (event) => {
          const spot = local(event), end = drag;
          drag = null;
          if (end) { event.stopPropagation(); if (end.to) dropped(end.at, end.to); return; }
          const at = down && far(spot, down) < 4 ? nearest(spot, 12) : -1;
          if (at >= 0) clicked(at);
        });
        for (const name of ["mousedown", "mousemove", "mouseup", "touchstart", "touchmove"]) on(name, (event) => { if (drag) event.stopPropagation(); });
      },
      async home() { await ready; await preview(false); await look(home); },
      async visible(at, path, frusta) {
        groups[at].shown = [path, path && frusta, path];
        if (!frame) await restyle({ visible: groups[at].shown }, all(groups[at]));
      },
      // Another path and other viewpoints in the place of a track's.
      async redraw(at, path, poses) {
        await shape(groups[at].line, columns(points(path.xyz)));
        await shape(groups[at].frusta, small(poses));
      },
      // The camera of one pose, where a track's own would fly.
      point: (at, pose) => shape(groups[at].flying, large(pose ? [pose] : [])),
      // A trace of its own by name: places, and its style.
      async overlay(name, places, style) {
        await ready;
        if (name in overlays) return shape(overlays[name], columns(places));
        overlays[name] = root.data.length;
        await Plotly.addTraces(root, { type: "scatter3d", showlegend: false, hoverinfo: "skip", ...columns(places), ...style });
      },
      // Reports clicks on the surface as places in metres, while on.
      async clicks(on, report) {
        await restyle({ hoverinfo: on ? "none" : "skip" }, [0]);
        root.removeAllListeners("plotly_click");
        if (on) root.on("plotly_click", ({ points: [at] }) => { if (at && at.curveNumber === 0) report([at.x, at.y, at.z]); });
      },
      coloured: (codes) => paint(codes || new Uint8Array(triangles.length || vertices.length), STATE_SCALE),
      // A quantity as {name, codes, step}: from dark to bright; grey where no sharp picture is.
      measured({ name, codes, step }) {
        const grey = [0, 19.9 / 264].map((share) => [share, STATES[0][1]]), most = 254 * step;
        return paint(Float32Array.from(unpack(codes), (code) => (code === 255 ? -10 : code) * step), { cmin: -10 * step, cmax: most,
          colorscale: [...grey, ...ramp(["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"], 20 / 264)],
          ...bar(name, { tickvals: [0, 0.25, 0.5, 0.75, 1].map((share) => share * most), tickformat: ".3~g" }) });
      },
      // Where places lie close together: bright where many are within `share` of the structure's size.
      heat(places, share, title) {
        const reach = share * Math.hypot(...size), faces = triangles.length ? triangles.map((face) => Array.from(face, (at) => vertices[at])) : vertices.map((vertex) => [vertex]);
        const values = Float32Array.from(faces, (face) => {
          const own = [0, 1, 2].map((axis) => face.reduce((sum, corner) => sum + corner[axis], 0) / face.length);
          return places.reduce((sum, place) => sum + Math.exp(-((Math.hypot(...plus(place, own, -1)) / reach) ** 2) / 2), 0);
        });
        const most = values.reduce((a, b) => Math.max(a, b), 1);
        return paint(values, { cmin: 0, cmax: most, colorscale: ramp(["#c7cdd6", "#fdebb0", "#f7a65a", "#d94f3a", "#7a1712"]), ...bar(title, { dtick: Math.ceil(most / 6) }) });
      },
      // The view as a PNG's address, for print; drawn and read in one go, since the browser clears what it has shown.
      shot() {
        const plot = (inside() || {}).glplot;
        if (!plot || !plot.redraw || !plot.canvas) return "";
        plot.redraw();
        return plot.canvas.toDataURL("image/png");
      },
      purge() { Plotly.purge(root); },
    };

    // Plotly's scene: it has no option for the angle of its lens, and no other place to ask for its eye.
    function inside() { return ((root._fullLayout || {}).scene || {})._scene; }
    function standing() { return inside() ? inside().getCamera() : home; }
    // The eye as it stands: its directions, and how many pixels a unit takes at depth 1.
    function lookout() {
      const [eye, at, up] = ["eye", "center", "up"].map((name) => { const { x, y, z } = standing()[name]; return [x, y, z]; });
      const ahead = unit(plus(at, eye, -1)), right = unit(cross(ahead, up));
      return { eye, ahead, right, above: cross(right, ahead), scale: root.clientHeight / 2 / Math.tan(FOV / 2) };
    }
    // Where a place in metres is drawn, px from the upper left, and its depth.
    function onScreen(place) {
      const { eye, ahead, right, above, scale } = lookout();
      const from = plus(inPlot(place), eye, -1), depth = dot(from, ahead);
      return [root.clientWidth / 2 + (scale * dot(from, right)) / depth, root.clientHeight / 2 - (scale * dot(from, above)) / depth, depth];
    }
    // The place that lies so many pixels to the right and down of another, at the same depth.
    function byScreen(place, across, down) {
      const { right, above, scale } = lookout(), depth = onScreen(place)[2];
      return plus(place, plus(right.map((value) => value * across), above, -down), (longest * depth) / scale);
    }

    // Through the camera: the picture's frame over the view, its angle for the lens, and no paths or viewpoints in it.
    async function preview(aboard) {
      if (Boolean(frame) !== aboard) {
        if (frame) frame.remove();
        frame = aboard ? element("div", { class: "frame" }, element("span", {}, "picture of the camera")) : null;
        if (frame) root.append(frame);
        for (const own of groups) await restyle({ visible: aboard ? [false, false, false] : own.shown }, all(own));
      }
      if (!frame) { lens(FOV); return; }
      const [across, upward] = tangents(camera, 120);
      const high = Math.min(0.88 * root.clientHeight, (0.94 * root.clientWidth * upward) / across);
      frame.style.height = high + "px";
      frame.style.width = (high * across) / upward + "px";
      lens(2 * Math.atan((upward * root.clientHeight) / high));
    }
    function lens(angle) {
      const plot = (inside() || {}).glplot;
      if (plot && typeof plot.fovy === "number") plot.fovy = angle;
    }

    function aboardCamera({ xyz, quat }) {
      const ahead = plus(xyz, turned(quat, [0.2 * longest, 0, 0]));
      return { eye: named(inPlot(xyz)), center: named(inPlot(ahead)), up: named(turned(quat, [0, 0, 1])) };
    }

    // The view from a direction, so far off that the structure and the first path are in it.
    function looking(towards, more = 1) {
      const right = unit([-towards[1], towards[0], 0]), up = cross(towards, right);
      const slope = 0.92 * Math.tan(FOV / 2), aspect = root.clientWidth / Math.max(root.clientHeight, 1);
      const far = sparse.reduce((most, from) => Math.max(most,
        (dot(from, towards) + Math.max(Math.abs(dot(from, right)) / aspect, Math.abs(dot(from, up))) / slope) / longest), 0.2);
      const center = inPlot(focus);
      return { eye: named(plus(center, towards, more * far)), center: named(center), up: { x: 0, y: 0, z: 1 } };
    }

    // How far the first path is flown beside the middle of the structure, as a share of its extent.
    function aside(axis) {
      const [low, high] = bounds(vertices)[axis], path = lines[0] || [];
      return path.reduce((sum, place) => sum + (place[axis] - (low + high) / 2) / path.length, 0) / Math.max(high - low, 1e-9);
    }
  };

  // A view after a step round the vertical, over the top, or away.
  function stepped({ eye, center, up }, [round, over, away]) {
    const from = ["x", "y", "z"].map((axis) => eye[axis] - center[axis]), far = Math.hypot(...from), step = Math.PI / 24;
    const heading = Math.atan2(from[1], from[0]) + round * step, pitch = Math.max(-1.5, Math.min(1.5, Math.asin(from[2] / far) + over * step));
    const direction = [Math.cos(pitch) * Math.cos(heading), Math.cos(pitch) * Math.sin(heading), Math.sin(pitch)];
    return { eye: named(plus([center.x, center.y, center.z], direction, far * 1.15 ** away)), center, up };
  }
})();
