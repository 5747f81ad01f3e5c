// One 3-D view: a structure, paths, camera frusta, and a camera that flies.
"use strict";

(function () {
  const { unpack, STATES } = upplied;
  const FOV = Math.PI / 4; // of the viewer's own eye

  // A path as arrays, with poses at any share 0 .. 1 of its duration.
  upplied.path = function (data) {
    const path = {};
    for (const [name, packed] of Object.entries(data)) path[name] = unpack(packed);
    path.count = path.t.length;
    path.duration = path.count ? path.t[path.count - 1] : 0;
    path.at = function (share) {
      const time = share * path.duration;
      let low = 0, high = path.count - 1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (path.t[middle] <= time) low = middle; else high = middle;
      }
      const step = path.t[high] - path.t[low];
      const part = step > 0 ? Math.min(1, Math.max(0, (time - path.t[low]) / step)) : 0;
      const mix = (values, width, axis) => values[low * width + axis] * (1 - part) + values[high * width + axis] * part;
      let q = [0, 1, 2, 3].map((axis) => mix(path.quat, 4, axis));
      const dot = [0, 1, 2, 3].reduce((sum, axis) => sum + path.quat[low * 4 + axis] * path.quat[high * 4 + axis], 0);
      if (dot < 0) q = [0, 1, 2, 3].map((axis) => path.quat[low * 4 + axis] * (1 - part) - path.quat[high * 4 + axis] * part);
      const length = Math.hypot(...q) || 1;
      return {
        time, xyz: [0, 1, 2].map((axis) => mix(path.xyz, 3, axis)), quat: q.map((value) => value / length),
        speed: mix(path.speed, 1, 0), clearance: mix(path.clearance, 1, 0), standoff: mix(path.standoff, 1, 0),
      };
    };
    return path;
  };

  // The vector v in the camera frame (forward, left, up), turned by the quaternion x y z w.
  function turned([x, y, z, w], [a, b, c]) {
    const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
    return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
  }

  upplied.corners = corners;
  function corners(xyz, quat, camera, depth) {
    const across = Math.tan((Math.min(camera.hfov_deg, 150) * Math.PI) / 360) * depth;
    const upward = Math.tan((Math.min(camera.vfov_deg, 150) * Math.PI) / 360) * depth;
    return [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([left, up]) => turned(quat, [depth, left * across, up * upward]).map((value, axis) => value + xyz[axis]));
  }

  // Edges of pyramids as one broken line.
  function pyramids(poses, camera, depth) {
    const line = { x: [], y: [], z: [] };
    const add = (point) => { ["x", "y", "z"].forEach((axis, at) => line[axis].push(point ? point[at] : null)); };
    for (const { xyz, quat } of poses) {
      const [a, b, c, d] = corners(xyz, quat, camera, depth);
      for (const point of [a, b, c, d, a, xyz, b, null, c, xyz, d, null]) add(point);
    }
    return line;
  }

  // As many of the poses as stand a step apart along the way, evenly chosen.
  function apart(poses, step) {
    let way = 0;
    for (let at = 1; at < poses.length; at++) way += Math.hypot(...[0, 1, 2].map((axis) => poses[at].xyz[axis] - poses[at - 1].xyz[axis]));
    const every = Math.max(1, Math.ceil(poses.length / Math.max(2, way / step)));
    return poses.filter((_, at) => at % every === 0);
  }

  function scaleOf() {
    const colorscale = STATES.flatMap(([, colour], at) => [[at / STATES.length, colour], [(at + 1) / STATES.length, colour]]);
    return { cmin: -0.5, cmax: STATES.length - 0.5, colorscale, showscale: false };
  }

  function surface(structure, states) {
    const vertices = unpack(structure.vertices), triangles = unpack(structure.triangles);
    const axis = (values, at) => { const out = new Float32Array(values.length / 3); for (let i = 0; i < out.length; i++) out[i] = values[3 * i + at]; return out; };
    const [x, y, z] = [0, 1, 2].map((at) => axis(vertices, at));
    const scale = scaleOf();
    if (!triangles.length) {
      return { type: "scatter3d", mode: "markers", x, y, z, hoverinfo: "skip", showlegend: false,
        marker: { size: 2.5, color: states || new Uint8Array(x.length), ...scale } };
    }
    const corner = (at) => { const out = new Int32Array(triangles.length / 3); for (let i = 0; i < out.length; i++) out[i] = triangles[3 * i + at]; return out; };
    return { type: "mesh3d", x, y, z, i: corner(0), j: corner(1), k: corner(2), intensitymode: "cell",
      intensity: states || new Uint8Array(triangles.length / 3), ...scale, flatshading: true, hoverinfo: "skip", showlegend: false,
      lighting: { ambient: 0.62, diffuse: 0.55, specular: 0.08, roughness: 0.9, fresnel: 0.05, vertexnormalsepsilon: 1e-12, facenormalsepsilon: 1e-12 },
      lightposition: { x: -20000, y: -60000, z: 90000 } };
  }

  // scene(root, structure, camera, tracks): tracks are {name, colour, path, viewpoints, states, width}.
  // `room` is how far beyond them something may come to be drawn, m.
  upplied.scene = function (root, structure, camera, tracks, room = 0) {
    const bounds = [0, 1, 2].map((axis) => extent(axis, unpack(structure.vertices), tracks)).map(([low, high]) => [low - room, high + room]);
    const size = bounds.map(([low, high]) => Math.max(high - low, 1e-3));
    const longest = Math.max(...size);
    const middle = bounds.map(([low, high]) => (low + high) / 2);
    const states = tracks.map((track) => track.states).find(Boolean) || null;
    const traces = [surface(structure, states)];
    const groups = tracks.map((track) => {
      const own = { line: traces.length, frusta: traces.length + 1, flying: traces.length + 2 };
      const xyz = { x: [], y: [], z: [] };
      for (let i = 0; i < track.path.count; i++) ["x", "y", "z"].forEach((axis, at) => xyz[axis].push(track.path.xyz[3 * i + at]));
      const shared = { type: "scatter3d", mode: "lines", showlegend: false };
      const label = Array.from({ length: track.path.count }, (_, i) => track.name + "<br>" + track.path.t[i].toFixed(1) + " s, clearance " + upplied.format(track.path.clearance[i], 1, " m"));
      traces.push({ ...shared, ...xyz, line: { color: track.colour, width: track.width || 5 }, text: label, hoverinfo: "text" });
      traces.push({ ...shared, ...pyramids(apart(track.viewpoints, 0.07 * longest), camera, 0.045 * longest), line: { color: track.colour, width: 2 }, opacity: 0.75, hoverinfo: "skip" });
      traces.push({ ...shared, ...pyramids([track.path.at(0)], camera, 0.1 * longest), line: { color: upplied.colour("--ink"), width: 6 }, hoverinfo: "skip" });
      return own;
    });
    const [ahead, aside] = side(structure, tracks);
    const towards = [ahead * 0.562, aside * 0.719, 0.407].map((value) => value / Math.hypot(0.562, 0.719, 0.407));
    const focus = [0, 1, 2].map((axis) => { const [low, high] = extent(axis, unpack(structure.vertices), tracks.slice(0, 1)); return (low + high) / 2; });
    const far = distance(structure, tracks, focus, longest, towards, root.clientWidth / Math.max(root.clientHeight, 1));
    const center = focus.map((value, axis) => (value - middle[axis]) / longest);
    const point = (values) => ({ x: values[0], y: values[1], z: values[2] });
    const home = { eye: point(center.map((value, axis) => value + far * towards[axis])), center: point(center), up: { x: 0, y: 0, z: 1 } };
    const axis = (at) => ({ visible: false, autorange: false, range: bounds[at] });
    const layout = {
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, hoverlabel: { font: { size: 12 } },
      scene: { xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual", camera: home,
        aspectratio: { x: size[0] / longest, y: size[1] / longest, z: size[2] / longest } },
    };
    const overlays = {};
    let frame = null;
    const ready = Plotly.newPlot(root, traces, layout, { displaylogo: false, responsive: true, displayModeBar: false, scrollZoom: true });
    const paint = async (values, style) => {
      await ready;
      const own = structure.triangles.data ? "" : "marker.", update = { [own ? "marker.color" : "intensity"]: [values] };
      for (const [key, value] of Object.entries(style)) update[own + key] = [value];
      await Plotly.restyle(root, update, [0]);
    };

    root.addEventListener("keydown", (event) => {
      const camera = turnedBy(event.key, (root._fullLayout || {}).scene && root._fullLayout.scene._scene ? root._fullLayout.scene._scene.getCamera() : home);
      if (!camera) return;
      event.preventDefault();
      ready.then(() => Plotly.relayout(root, { "scene.camera": event.key === "Home" ? home : camera }));
    });

    // Views are exact: the eye of the plot in its own units, from metres.
    const inPlot = (point) => ({ x: (point[0] - middle[0]) / longest, y: (point[1] - middle[1]) / longest, z: (point[2] - middle[2]) / longest });
    return {
      ready,
      async fly(share, aboard, chosen) {
        await ready;
        preview(aboard);
        const tips = { x: [], y: [], z: [] };
        const poses = tracks.map((track) => track.path.at(share));
        for (const pose of poses) {
          const line = pyramids(aboard ? [] : [pose], camera, 0.1 * longest);
          for (const name of ["x", "y", "z"]) tips[name].push(line[name]);
        }
        if (groups.length) await Plotly.restyle(root, tips, groups.map((own) => own.flying));
        if (aboard && poses[chosen]) await Plotly.relayout(root, { "scene.camera": aboardCamera(poses[chosen]) });
        return poses;
      },
      // The view from where a pose is, so far off that all is in view; or as its camera sees.
      async face(pose, aboard) {
        await ready;
        await preview(aboard);
        if (aboard) return Plotly.relayout(root, { "scene.camera": aboardCamera(pose) });
        const [ahead, aside] = [0, 1].map((axis) => pose.xyz[axis] - focus[axis]), flat = Math.hypot(ahead, aside) || 1;
        const back = [0.9 * ahead / flat, 0.9 * aside / flat, 0.436];
        const off = 1.04 * distance(structure, tracks, focus, longest, back, root.clientWidth / Math.max(root.clientHeight, 1));
        const eye = center.map((value, axis) => value + off * back[axis]);
        return Plotly.relayout(root, { "scene.camera": { eye: point(eye), center: point(center), up: home.up } });
      },
      // The pointer takes a place, in metres, along in the plane of the screen. `held` tells whether the place number
      // `at` may be taken; `moved` hears of each step, `dropped` of the last; a click near another is `clicked`.
      drags({ places, held, moved, dropped, clicked }) {
        let drag = null, down = null;
        const local = (event) => { const box = root.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
        const nearest = (spot, most) => {
          const seen = places().map((place) => onScreen(place)).map(([x, y, depth], at) => [depth > 0 ? Math.hypot(x - spot[0], y - spot[1]) : Infinity, at]);
          return seen.reduce((best, each) => (each[0] < best[0] ? each : best), [most, -1])[1];
        };
        root.addEventListener("pointerdown", (event) => {
          down = local(event);
          const at = event.button ? -1 : places().findIndex((place, at) => { const [x, y, depth] = onScreen(place); return held(at) && depth > 0 && Math.hypot(x - down[0], y - down[1]) < 16; });
          if (at < 0) return;
          event.preventDefault(); event.stopPropagation();
          root.setPointerCapture(event.pointerId);
          drag = { at, from: down, place: places()[at], to: null };
        }, true);
        root.addEventListener("pointermove", (event) => {
          const spot = local(event);
          if (!drag) { const at = event.buttons ? -1 : nearest(spot, 16); root.style.cursor = at < 0 ? "" : held(at) ? "grab" : "pointer"; return; }
          event.stopPropagation();
          drag.to = byScreen(drag.place, spot[0] - drag.from[0], spot[1] - drag.from[1]);
          moved(drag.at, drag.to);
        }, true);
        root.addEventListener("pointerup", (event) => {
          const spot = local(event), end = drag;
          drag = null;
          if (end) { event.stopPropagation(); if (end.to) dropped(end.at, end.to); return; }
          const at = down && Math.hypot(spot[0] - down[0], spot[1] - down[1]) < 4 ? nearest(spot, 12) : -1;
          if (at >= 0) clicked(at);
        }, true);
        for (const name of ["mousedown", "mousemove", "mouseup", "touchstart", "touchmove"]) root.addEventListener(name, (event) => { if (drag) event.stopPropagation(); }, true);
      },
      async home() { await ready; await preview(false); await Plotly.relayout(root, { "scene.camera": home }); },
      async visible(at, path, frusta) {
        await ready;
        groups[at].shown = [path, path && frusta, path];
        if (!frame) await Plotly.restyle(root, { visible: groups[at].shown }, [groups[at].line, groups[at].frusta, groups[at].flying]);
      },
      // Another path and other viewpoints in the place of a track's.
      async redraw(at, path, poses) {
        await ready;
        const xyz = { x: [[]], y: [[]], z: [[]] };
        for (let i = 0; i < path.count; i++) ["x", "y", "z"].forEach((axis, k) => xyz[axis][0].push(path.xyz[3 * i + k]));
        await Plotly.restyle(root, xyz, [groups[at].line]);
        await this.shape(groups[at].frusta, pyramids(apart(poses, 0.07 * longest), camera, 0.045 * longest));
      },
      // The camera of one pose, where a track's own would fly.
      async point(at, pose) { await ready; await this.shape(groups[at].flying, pyramids(pose ? [pose] : [], camera, 0.1 * longest)); },
      // A trace of its own by name: {x, y, z}, and its style.
      async overlay(name, shape, look) {
        await ready;
        if (name in overlays) return this.shape(overlays[name], shape);
        overlays[name] = root.data.length;
        await Plotly.addTraces(root, { type: "scatter3d", showlegend: false, hoverinfo: "skip", ...shape, ...look });
      },
      async shape(trace, { x, y, z }) { await Plotly.restyle(root, { x: [x], y: [y], z: [z] }, [trace]); },
      // Reports clicks on the surface as places in metres, while on.
      async clicks(on, report) {
        await ready;
        await Plotly.restyle(root, { hoverinfo: on ? "none" : "skip" }, [0]);
        root.removeAllListeners("plotly_click");
        if (on) root.on("plotly_click", ({ points }) => { if (points.length && points[0].curveNumber === 0) report([points[0].x, points[0].y, points[0].z]); });
      },
      async coloured(codes) { await paint(codes, scaleOf()); },
      // A quantity as {name, codes, step}: from dark to bright; grey where no sharp picture is.
      async measured({ name, codes, step }) {
        const values = Float32Array.from(unpack(codes), (code) => (code === 255 ? -10 : code) * step), most = 254 * step;
        const ramp = ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"].map((colour, at, all) => [(20 + (244 * at) / (all.length - 1)) / 264, colour]);
        await paint(values, { cmin: -10 * step, cmax: most, colorscale: [[0, "#c7cdd6"], [19.9 / 264, "#c7cdd6"], ...ramp], showscale: true, colorbar: { title: { text: name }, thickness: 12, len: 0.6, tickvals: [0, 0.25, 0.5, 0.75, 1].map((share) => share * most), tickformat: ".3~g" } });
      },
      // Where places (x y z of each) lie close together: bright where many are within `share` of the structure's size.
      async heat(places, share, title) {
        const reach = share * Math.hypot(...size), vertices = unpack(structure.vertices), triangles = unpack(structure.triangles);
        const count = (triangles.length || vertices.length) / 3, values = new Float32Array(count);
        for (let i = 0; i < count; i++) {
          const corners = triangles.length ? [0, 1, 2].map((at) => 3 * triangles[3 * i + at]) : [3 * i];
          const middle = [0, 1, 2].map((axis) => corners.reduce((sum, at) => sum + vertices[at + axis], 0) / corners.length);
          for (const place of places) values[i] += Math.exp(-((place[0] - middle[0]) ** 2 + (place[1] - middle[1]) ** 2 + (place[2] - middle[2]) ** 2) / (2 * reach * reach));
        }
        const ramp = ["#c7cdd6", "#fdebb0", "#f7a65a", "#d94f3a", "#7a1712"].map((colour, at, all) => [at / (all.length - 1), colour]);
        const most = values.reduce((sofar, value) => Math.max(sofar, value), 1);
        await paint(values, { cmin: 0, cmax: most, colorscale: ramp, showscale: true, colorbar: { title: { text: title }, thickness: 14, len: 0.6, dtick: Math.ceil(most / 6) } });
      },
      // The view as a PNG's address, for print; drawn and read in one go, since the browser clears what it has shown.
      shot() {
        const plot = inside();
        if (!plot || !plot.redraw || !plot.canvas) return "";
        plot.redraw();
        return plot.canvas.toDataURL("image/png");
      },
      purge() { Plotly.purge(root); },
    };

    // The eye as it stands: its directions, and how many pixels a unit takes at depth 1.
    function lookout() {
      const plot = root._fullLayout && root._fullLayout.scene && root._fullLayout.scene._scene;
      const camera = plot ? plot.getCamera() : home;
      const [eye, at, up] = [camera.eye, camera.center, camera.up].map(({ x, y, z }) => [x, y, z]);
      const unit = (v) => v.map((value) => value / (Math.hypot(...v) || 1)), cross = (a, b) => [0, 1, 2].map((k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
      const ahead = unit(at.map((value, axis) => value - eye[axis])), right = unit(cross(ahead, up));
      return { eye, ahead, right, above: cross(right, ahead), scale: root.clientHeight / 2 / Math.tan(FOV / 2) };
    }
    function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
    // Where a place in metres is drawn, px from the upper left, and its depth.
    function onScreen(place) {
      const { eye, ahead, right, above, scale } = lookout();
      const from = place.map((value, axis) => (value - middle[axis]) / longest - eye[axis]), depth = dot(from, ahead);
      return [root.clientWidth / 2 + (scale * dot(from, right)) / depth, root.clientHeight / 2 - (scale * dot(from, above)) / depth, depth];
    }
    // The place that lies so many pixels to the right and down of another, at the same depth.
    function byScreen(place, across, down) {
      const { right, above, scale } = lookout(), depth = onScreen(place)[2];
      return place.map((value, axis) => value + (longest * depth * (across * right[axis] - down * above[axis])) / scale);
    }

    function inside() {
      const scene = root._fullLayout && root._fullLayout.scene && root._fullLayout.scene._scene;
      return scene && scene.glplot;
    }

    // Through the camera: the picture's frame over the view, its angle for the lens, and no paths or viewpoints in it.
    async function preview(aboard) {
      if (Boolean(frame) !== aboard) {
        if (frame) frame.remove();
        frame = aboard ? upplied.element("div", { class: "frame" }, upplied.element("span", {}, "picture of the camera")) : null;
        if (frame) root.append(frame);
        for (const own of groups) {
          const shown = own.shown || [true, true, true];
          await Plotly.restyle(root, { visible: aboard ? [false, false, false] : shown }, [own.line, own.frusta, own.flying]);
        }
      }
      if (!frame) { lens((FOV * 180) / Math.PI); return; }
      const [across, upward] = [camera.hfov_deg, camera.vfov_deg].map((angle) => Math.tan((Math.min(angle, 120) * Math.PI) / 360));
      const high = Math.min(0.88 * root.clientHeight, (0.94 * root.clientWidth * upward) / across);
      frame.style.height = high + "px";
      frame.style.width = (high * across) / upward + "px";
      lens((360 / Math.PI) * Math.atan((upward * root.clientHeight) / high));
    }

    // Plotly has no option for the angle of its lens; where its scene can be reached, it is the camera's own.
    function lens(degrees) {
      const plot = inside();
      if (plot && typeof plot.fovy === "number") plot.fovy = (degrees * Math.PI) / 180;
    }

    function aboardCamera({ xyz, quat }) {
      const ahead = turned(quat, [0.2 * longest, 0, 0]).map((value, at) => value + xyz[at]);
      const [x, y, z] = turned(quat, [0, 0, 1]);
      return { eye: inPlot(xyz), center: inPlot(ahead), up: { x, y, z } };
    }
  };

  // How far the eye must stand, in units of the longest side, to see the structure and the first path.
  function distance(structure, tracks, focus, longest, towards, aspect) {
    const flat = Math.hypot(towards[0], towards[1]);
    const right = [-towards[1] / flat, towards[0] / flat, 0];
    const up = [-towards[2] * right[1], towards[2] * right[0], flat];
    const slope = 0.92 * Math.tan(FOV / 2);
    let far = 0.2;
    const see = (point) => {
      const local = point.map((value, axis) => (value - focus[axis]) / longest);
      const along = (axis) => local[0] * axis[0] + local[1] * axis[1] + local[2] * axis[2];
      far = Math.max(far, along(towards) + Math.abs(along(right)) / (slope * aspect), along(towards) + Math.abs(along(up)) / slope);
    };
    const vertices = unpack(structure.vertices), step = 3 * Math.ceil(vertices.length / 9000);
    for (let i = 0; i < vertices.length; i += step) see([0, 1, 2].map((axis) => vertices[i + axis]));
    for (const { path } of tracks.slice(0, 1)) for (let i = 0; i < path.count; i++) see([0, 1, 2].map((axis) => path.xyz[3 * i + axis]));
    return far;
  }

  // The view after a key: round the vertical, over the top, nearer or farther; null for any other key.
  function turnedBy(key, { eye, center, up }) {
    const away = ["x", "y", "z"].map((axis) => eye[axis] - center[axis]);
    const far = Math.hypot(...away);
    let [heading, pitch, distance] = [Math.atan2(away[1], away[0]), Math.asin(away[2] / far), far];
    const step = Math.PI / 24;
    if (key === "ArrowLeft") heading -= step; else if (key === "ArrowRight") heading += step;
    else if (key === "ArrowUp") pitch = Math.min(pitch + step, 1.5); else if (key === "ArrowDown") pitch = Math.max(pitch - step, -1.5);
    else if (key === "+" || key === "=") distance /= 1.15; else if (key === "-") distance *= 1.15;
    else if (key !== "Home") return null;
    const offset = [Math.cos(pitch) * Math.cos(heading), Math.cos(pitch) * Math.sin(heading), Math.sin(pitch)];
    return { eye: { x: center.x + distance * offset[0], y: center.y + distance * offset[1], z: center.z + distance * offset[2] }, center, up };
  }

  // From which side the first path is flown: signs of x and y of the eye.
  function side(structure, tracks) {
    if (!tracks.length) return [1, -1];
    const vertices = unpack(structure.vertices), { xyz, count } = tracks[0].path;
    const offset = [0, 1].map((axis) => {
      const [low, high] = extent(axis, vertices, []);
      let sum = 0;
      for (let i = axis; i < xyz.length; i += 3) sum += xyz[i];
      return (sum / count - (low + high) / 2) / Math.max(high - low, 1e-9);
    });
    return [offset[0] < -0.25 ? -1 : 1, offset[1] > 0.05 ? 1 : -1];
  }

  function extent(axis, vertices, tracks) {
    let low = Infinity, high = -Infinity;
    for (const values of [vertices, ...tracks.map((track) => track.path.xyz)]) {
      for (let i = axis; i < values.length; i += 3) {
        if (values[i] < low) low = values[i];
        if (values[i] > high) high = values[i];
      }
    }
    return [low, high];
  }
})();
