// The flight again, in the page: no library, nothing fetched. First what can be reckoned without a page, then the drawing.
(function () {
  "use strict";

  // Columns are differences, in whole steps of a unit.
  function column(differences, unit) {
    var sum = 0;
    return differences.map(function (d) { sum += d; return sum * unit; });
  }

  // A value that seldom changes: each with the index from which it holds.
  function held(steps, length) {
    var all = [], k = 0;
    for (var index = 0; index < length; index++) {
      while (k + 1 < steps.length && steps[k + 1][0] <= index) k++;
      all.push(steps[k][1]);
    }
    return all;
  }

  function decode(raw) {
    var flight = {};
    Object.keys(raw).forEach(function (key) { flight[key] = raw[key]; });
    flight.t = column(raw.t, 1e-4);
    flight.h = {
      user: column(raw.h.u, 1e-2), eve: column(raw.h.e, 1e-2), which: held(raw.h.k, raw.t.length), on: held(raw.h.on, raw.t.length)
    };
    flight.v = raw.v.map(function (v) {
      return {
        known: held(v.k, flight.t.length), slot: held(v.s, flight.t.length), watts: held(v.w, flight.t.length),
        mode: held(v.m, flight.t.length),
        p: v.p.map(function (c) { return column(c, 1e-2); }),
        a: v.a.map(function (c) { return column(c, 1e-4); })
      };
    });
    return flight;
  }

  // The last instant that is not after t.
  function indexAt(flight, t) {
    var low = 0, high = flight.t.length - 1;
    while (low < high) {
      var middle = (low + high + 1) >> 1;
      if (flight.t[middle] <= t) low = middle; else high = middle - 1;
    }
    return low;
  }

  // A vehicle at t, between two instants; null while nothing is known of it.
  function vehicleAt(flight, which, t) {
    var v = flight.v[which], k = indexAt(flight, t);
    if (!flight.t.length || !v.known[k]) return null;
    var n = k + 1 < flight.t.length && v.known[k + 1] ? k + 1 : k;
    var part = n > k ? Math.max(0, Math.min(1, (t - flight.t[k]) / (flight.t[n] - flight.t[k] || 1))) : 0;
    var mix = function (c) { return c[k] + part * (c[n] - c[k]); };
    var axis = v.a.map(mix), length = Math.hypot(axis[0], axis[1], axis[2]) || 1;
    return {
      p: v.p.map(mix), axis: axis.map(function (c) { return c / length; }), watts: v.watts[k], slot: v.slot[k], mode: v.mode[k]
    };
  }

  // The ideal dipole, as radio::pattern has it: 1 - <u, Y>^2.
  function patternAt(vehicle, node) {
    var d = node.map(function (c, k) { return c - vehicle.p[k]; }), a = vehicle.axis;
    var square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    var x = d[1] * a[2] - d[2] * a[1], y = d[2] * a[0] - d[0] * a[2], z = d[0] * a[1] - d[1] * a[0];
    return square > 0 ? Math.min(1, (x * x + y * y + z * z) / square) : 0;
  }

  // As radio::link has it: nothing is nearer than a metre.
  function received(vehicle, node, gain) {
    if (!vehicle || !(vehicle.watts > 0)) return 0;
    var square = node.reduce(function (sum, c, k) { return sum + (c - vehicle.p[k]) * (c - vehicle.p[k]); }, 0);
    return gain * patternAt(vehicle, node) * vehicle.watts / Math.max(square, 1);
  }

  function sinr(pair, node, radio) {
    return received(pair[0], node, radio.gain) / (received(pair[1], node, radio.gain) + radio.noise);
  }

  function bits(pair, node, radio) { return Math.log2(1 + sinr(pair, node, radio)); }

  // What the record says was heard, in decibels and bit/s/Hz; null while nothing was.
  function heardAt(flight, t) {
    var k = indexAt(flight, t), h = flight.h;
    if (!h.on[k]) return null;
    var bitsOf = function (decibels) { return Math.log2(1 + Math.pow(10, decibels / 10)); };
    var eve = h.which[k] < 0 ? 0 : bitsOf(h.eve[k]);
    return { user: h.user[k], eve: h.eve[k], which: h.which[k], secrecy: Math.max(0, bitsOf(h.user[k]) - eve) };
  }

  // Everything about an instant that does not need a drawing.
  function stateAt(flight, t) {
    var pair = [vehicleAt(flight, 0, t), vehicleAt(flight, 1, t)];
    var state = { t: t, pair: pair, user: null, heard: flight.t.length ? heardAt(flight, t) : null };
    var planned = pair[0] && pair[0].watts > 0 ? flight.slots[pair[0].slot] : null;
    if (!planned || !flight.radio || !pair[1]) return state;
    flight.users.forEach(function (user) { if (user.n === planned.u) state.user = user; });
    if (!state.user) return state;
    state.userSinr = sinr(pair, state.user.p, flight.radio);
    state.eves = flight.eves.map(function (e) { return sinr(pair, e.t || e.p, flight.radio); });
    state.strongest = state.eves.reduce(function (best, value, k) { return best < 0 || value > state.eves[best] ? k : best; }, -1);
    var loudest = state.strongest < 0 ? 0 : state.eves[state.strongest];
    state.userBits = Math.log2(1 + state.userSinr);
    state.secrecy = Math.max(0, state.userBits - Math.log2(1 + loudest));
    return state;
  }

  // Bit/s/Hz of the user's secret if the only eavesdropper were at this place; null while I is silent.
  function rateAt(flight, state, node) {
    return state.user ? Math.max(0, state.userBits - bits(state.pair, node, flight.radio)) : null;
  }

  // Mission ENU to latitude, longitude and height on the ellipsoid WGS 84, as the program reckons it.
  function geodetic(origin, p) {
    var A = 6378137, F = 1 / 298.257223563, E2 = F * (2 - F), rad = Math.PI / 180;
    var la = origin[0] * rad, lo = origin[1] * rad, sl = Math.sin(la), cl = Math.cos(la), so = Math.sin(lo), co = Math.cos(lo);
    var n = A / Math.sqrt(1 - E2 * sl * sl);
    var x = (n + origin[2]) * cl * co - so * p[0] - sl * co * p[1] + cl * co * p[2];
    var y = (n + origin[2]) * cl * so + co * p[0] - sl * so * p[1] + cl * so * p[2];
    var z = (n * (1 - E2) + origin[2]) * sl + cl * p[1] + sl * p[2];
    var flat = Math.hypot(x, y), lat = Math.atan2(z, flat * (1 - E2)), h = 0;
    for (var k = 0; k < 6; k++) {
      n = A / Math.sqrt(1 - E2 * Math.sin(lat) * Math.sin(lat));
      h = flat / Math.cos(lat) - n;
      lat = Math.atan2(z, flat * (1 - E2 * n / (n + h)));
    }
    return [lat / rad, Math.atan2(y, x) / rad, h];
  }

  // Why a vehicle is silent at t, in words.
  function silence(flight, which, t) {
    var last = null;
    flight.off.forEach(function (off) { if (off[1] === which && off[0] <= t + 1e-6) last = off; });
    return last ? last[2] : "it has not been on the air yet";
  }

  function phase(flight, which, t) {
    var now = "";
    flight.phases.forEach(function (p) { if (p[1] === which && p[0] <= t) now = p[2]; });
    return now;
  }

  if (typeof module !== "undefined" && module.exports) {
    module.exports = { decode: decode, stateAt: stateAt, heardAt: heardAt, rateAt: rateAt, geodetic: geodetic, silence: silence };
    return;
  }

  var root = document.getElementById("replay-view"), data = document.getElementById("replay-data");
  if (!root || !data) return;
  var flight = decode(JSON.parse(data.textContent));
  var at = function (id) { return document.getElementById("replay-" + id); };
  var plan = at("plan"), side = at("side"), slider = at("time"), play = at("play"), now = at("now"), speed = at("speed");
  var showRates = at("rates"), showNulls = at("nulls"), facing = at("facing"), told = at("told"), pointed = at("pointed");
  var begin = flight.t[0], end = flight.end, t = begin, playing = false, before = 0, pointer = null;
  var GRID = 90, ROLES = ["I", "J"], NULL = Math.asin(0.1);
  root.hidden = false;

  // The whole flight, with its fence, in a square.
  var home = (function () {
    var low = [Infinity, Infinity], high = [-Infinity, -Infinity], top = 10;
    var take = function (e, n) {
      low = [Math.min(low[0], e), Math.min(low[1], n)];
      high = [Math.max(high[0], e), Math.max(high[1], n)];
    };
    (flight.area || []).forEach(function (c) { take(c[0], c[1]); });
    flight.nofly.forEach(function (area) { area.c.forEach(function (c) { take(c[0], c[1]); }); });
    flight.users.concat(flight.eves).forEach(function (node) { take(node.p[0], node.p[1]); top = Math.max(top, node.p[2]); });
    flight.v.forEach(function (v) {
      v.p[0].forEach(function (e, k) { if (v.known[k]) { take(e, v.p[1][k]); top = Math.max(top, v.p[2][k]); } });
    });
    if (flight.alt && flight.area) top = Math.max(top, flight.alt[1]);
    if (low[0] > high[0]) take(0, 0);
    var reach = 1.08 * Math.max(10, (high[0] - low[0]) / 2, (high[1] - low[1]) / 2);
    return { x: (low[0] + high[0]) / 2, y: (low[1] + high[1]) / 2, reach: reach, top: 1.12 * top };
  })();
  var view = { x: home.x, y: home.y, reach: home.reach };
  // The brightest shade is what the best ground usually has: the middle one of some instants.
  var best = (function () {
    var served = flight.t.filter(function (time) { return stateAt(flight, time).user; }), most = [];
    for (var k = 0; k < 25 && served.length; k++) {
      var state = stateAt(flight, served[Math.floor(k / 25 * served.length)]), rate = 0;
      for (var cell = 0; cell < 256; cell++) {
        var e = home.x + ((cell % 16) / 7.5 - 1) * home.reach, n = home.y + (Math.floor(cell / 16) / 7.5 - 1) * home.reach;
        rate = Math.max(rate, rateAt(flight, state, [e, n, 0]));
      }
      most.push(rate);
    }
    most.sort(function (a, b) { return a - b; });
    return Math.max(1, Math.ceil(most[most.length >> 1] || 0));
  })();
  at("top").textContent = best + " bit/s/Hz and more";

  function css(name) { return getComputedStyle(root).getPropertyValue("--" + name).trim() || "#888"; }

  // A canvas as sharp as the screen; its size in CSS pixels.
  function sheet(canvas) {
    var box = canvas.getBoundingClientRect(), dots = window.devicePixelRatio || 1;
    var w = Math.max(50, Math.round(box.width)), h = Math.max(50, Math.round(box.height));
    if (canvas.width !== Math.round(w * dots) || canvas.height !== Math.round(h * dots)) {
      canvas.width = Math.round(w * dots);
      canvas.height = Math.round(h * dots);
    }
    var pen = canvas.getContext("2d");
    pen.setTransform(dots, 0, 0, dots, 0, 0);
    pen.font = "12px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    pen.fillStyle = css("paper");
    pen.fillRect(0, 0, w, h);
    return { pen: pen, left: 40, top: 8, w: w - 48, h: h - 40, taken: [], names: [] };
  }

  function line(pen, points, colour, width, dashes, closed) {
    if (!points.length) return;
    pen.beginPath();
    points.forEach(function (p, k) { if (k) pen.lineTo(p[0], p[1]); else pen.moveTo(p[0], p[1]); });
    if (closed) pen.closePath();
    pen.setLineDash(dashes || []);
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
    pen.setLineDash([]);
  }

  // Names keep clear of an axis, too.
  function axis(s, at, dx, dy, colour) {
    var ends = [[at[0] - dx, at[1] - dy], [at[0] + dx, at[1] + dy]];
    line(s.pen, ends, css("paper"), 5.5);
    line(s.pen, ends, colour, 3);
    [-1, -0.5, 0.5, 1].forEach(function (k) {
      var x = at[0] + k * dx, y = at[1] + k * dy;
      s.taken.push([x - 4, y - 4, x + 4, y + 4]);
    });
  }

  function marker(s, kind, at, colour) {
    var pen = s.pen, r = 4.5;
    if (kind === "cross") {
      line(pen, [[at[0] - r, at[1] - r], [at[0] + r, at[1] + r]], colour, 2);
      line(pen, [[at[0] - r, at[1] + r], [at[0] + r, at[1] - r]], colour, 2);
    } else {
      pen.beginPath();
      if (kind === "square") pen.rect(at[0] - r, at[1] - r, 2 * r, 2 * r);
      else if (kind === "diamond") {
        pen.moveTo(at[0], at[1] - 6); pen.lineTo(at[0] + 6, at[1]); pen.lineTo(at[0], at[1] + 6); pen.lineTo(at[0] - 6, at[1]);
        pen.closePath();
      } else pen.arc(at[0], at[1], kind === "ring" ? 3.5 : 4.5, 0, 7);
      pen.fillStyle = kind === "square" || kind === "ring" ? css("paper") : colour;
      pen.fill();
      pen.lineWidth = 1.6;
      pen.strokeStyle = colour;
      pen.stroke();
    }
    s.taken.push([at[0] - 7, at[1] - 7, at[0] + 7, at[1] + 7]);
  }

  // Names keep clear of markers and of each other: the nearest free of some places, or none at all.
  function names(s) {
    var pen = s.pen, high = 14;
    s.names.forEach(function (name) {
      var wide = pen.measureText(name.text).width + 4, found = null;
      if (name.at[0] < s.left || name.at[0] > s.left + s.w || name.at[1] < s.top || name.at[1] > s.top + s.h) return;
      [9, 14, 22, 32, 44].some(function (far) {
        return [0, 4, 2, 6, 1, 3, 5, 7].some(function (k) {
          var c = Math.cos(k * Math.PI / 4), d = Math.sin(k * Math.PI / 4);
          var x = name.at[0] + c * (far + wide / 2), y = name.at[1] - d * (far + high / 2);
          var box = [x - wide / 2, y - high / 2, x + wide / 2, y + high / 2];
          if (box[0] < s.left || box[2] > s.left + s.w || box[1] < s.top || box[3] > s.top + s.h) return false;
          var free = s.taken.every(function (o) { return o[2] <= box[0] || o[0] >= box[2] || o[3] <= box[1] || o[1] >= box[3]; });
          if (free) found = { x: x, y: y, box: box, far: far };
          return free;
        });
      });
      if (!found) return;
      s.taken.push(found.box);
      if (found.far > 14) line(pen, [name.at, [found.x, found.y]], name.colour, 0.8);
      pen.textAlign = "center";
      pen.lineWidth = 4;
      pen.strokeStyle = css("paper");
      pen.strokeText(name.text, found.x, found.y);
      pen.fillStyle = name.colour;
      pen.fillText(name.text, found.x, found.y);
    });
  }

  function step(span) {
    var raw = span / 6, ten = Math.pow(10, Math.floor(Math.log10(raw)));
    return [1, 2, 5, 10].map(function (k) { return k * ten; }).filter(function (k) { return k >= raw * 0.999; })[0];
  }

  function axes(s, across, up, toX, toY, labels) {
    var pen = s.pen, bottom = s.top + s.h;
    pen.fillStyle = css("ink");
    pen.textAlign = "center";
    var dx = step(across[1] - across[0]), dy = step(up[1] - up[0]);
    var figure = function (v) { return String(Math.round(v * 1e6) / 1e6).replace("-", "\u2212"); };
    for (var x = Math.ceil(across[0] / dx) * dx; x <= across[1]; x += dx) {
      line(pen, [[toX(x), bottom], [toX(x), bottom + 4]], css("muted"), 1);
      pen.fillText(figure(x), toX(x), bottom + 12);
    }
    pen.textAlign = "right";
    for (var y = Math.ceil(up[0] / dy) * dy; y <= up[1]; y += dy) {
      line(pen, [[s.left - 4, toY(y)], [s.left, toY(y)]], css("muted"), 1);
      pen.fillText(figure(y), s.left - 6, toY(y));
    }
    line(pen, [[s.left, s.top], [s.left + s.w, s.top], [s.left + s.w, bottom], [s.left, bottom]], css("rule"), 1, [], true);
    pen.textAlign = "center";
    pen.fillText(labels[0], s.left + s.w / 2, bottom + 25);
    pen.save();
    pen.translate(8, s.top + s.h / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText(labels[1], 0, 0);
    pen.restore();
  }

  function clip(s, draw) {
    s.pen.save();
    s.pen.beginPath();
    s.pen.rect(s.left, s.top, s.w, s.h);
    s.pen.clip();
    draw();
    s.pen.restore();
  }

  function trail(which) {
    var v = flight.v[which], points = [];
    for (var k = 0; k < flight.t.length && flight.t[k] <= t; k++) if (v.known[k]) points.push([v.p[0][k], v.p[1][k], v.p[2][k]]);
    var here = vehicleAt(flight, which, t);
    if (here) points.push(here.p);
    return points;
  }

  var SHADES = [[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120], [165, 156, 116],
    [195, 179, 105], [225, 204, 85], [254, 232, 56]];
  var ground = document.createElement("canvas");
  ground.width = ground.height = GRID;

  function rates(s, state, span, toX, toY) {
    var pen = ground.getContext("2d"), image = pen.createImageData(GRID, GRID);
    for (var row = 0; row < GRID; row++) {
      for (var col = 0; col < GRID; col++) {
        var e = span.x[0] + (col + 0.5) / GRID * (span.x[1] - span.x[0]), n = span.y[1] - (row + 0.5) / GRID * (span.y[1] - span.y[0]);
        var rate = rateAt(flight, state, [e, n, 0]), k = 4 * (row * GRID + col);
        var shade = SHADES[Math.min(9, Math.floor(rate / best * 10))];
        image.data[k] = shade[0]; image.data[k + 1] = shade[1]; image.data[k + 2] = shade[2]; image.data[k + 3] = 255;
      }
    }
    pen.putImageData(image, 0, 0);
    s.pen.imageSmoothingEnabled = true;
    s.pen.drawImage(ground, s.left, s.top, s.w, s.h);
  }

  // Where the gain on the ground is a hundredth: the edge of the null.
  function nullEdge(s, vehicle, span, toX, toY, colour) {
    var size = 70, values = [], place = function (c, r) {
      return [span.x[0] + c / size * (span.x[1] - span.x[0]), span.y[0] + r / size * (span.y[1] - span.y[0])];
    };
    for (var r = 0; r <= size; r++) for (var c = 0; c <= size; c++) {
      var p = place(c, r);
      values.push(patternAt(vehicle, [p[0], p[1], 0]) - 0.01);
    }
    var v = function (c, r) { return values[r * (size + 1) + c]; };
    for (r = 0; r < size; r++) for (c = 0; c < size; c++) {
      var ends = [], sides = [[c, r, c + 1, r], [c + 1, r, c + 1, r + 1], [c, r + 1, c + 1, r + 1], [c, r, c, r + 1]];
      sides.forEach(function (q) {
        var a = v(q[0], q[1]), b = v(q[2], q[3]);
        if ((a < 0) === (b < 0)) return;
        var part = a / (a - b), f = place(q[0] + part * (q[2] - q[0]), q[1] + part * (q[3] - q[1]));
        ends.push([toX(f[0]), toY(f[1])]);
      });
      for (var k = 0; k + 1 < ends.length; k += 2) {
        line(s.pen, [ends[k], ends[k + 1]], "#ffffff", 3.4);
        line(s.pen, [ends[k], ends[k + 1]], colour, 1.8);
      }
    }
  }

  // The axis, both ways, to the ground or as far as the picture goes.
  function beam(vehicle) {
    return [1, -1].map(function (sign) {
      var far = 4 * home.reach, down = sign * vehicle.axis[2];
      if (down < -1e-6) far = Math.min(far, -vehicle.p[2] / down);
      return vehicle.p.map(function (c, k) { return c + sign * far * vehicle.axis[k]; });
    });
  }

  function drawPlan(state) {
    var s = sheet(plan);
    var side = Math.min(s.w, s.h);
    s.w = s.h = side;
    var span = { x: [view.x - view.reach, view.x + view.reach], y: [view.y - view.reach, view.y + view.reach] };
    var toX = function (e) { return s.left + (e - span.x[0]) / (2 * view.reach) * s.w; };
    var toY = function (n) { return s.top + (span.y[1] - n) / (2 * view.reach) * s.h; };
    var flat = function (p) { return [toX(p[0]), toY(p[1])]; };
    plan.view = { s: s, span: span };
    clip(s, function () {
      var on = showRates.checked && state.user;
      if (on) rates(s, state, span, toX, toY);
      if (flight.area) line(s.pen, flight.area.map(flat), on ? "#ffffff" : css("muted"), 1.6, [8, 4], true);
      flight.nofly.forEach(function (area) {
        line(s.pen, area.c.map(flat), css("fault"), 2, [3, 3], true);
        s.names.push({ at: flat(area.c[0]), text: "no-fly: " + area.n, colour: css("fault") });
      });
      flight.eves.forEach(function (e) {
        e.r.forEach(function (radius) {
          s.pen.beginPath();
          s.pen.setLineDash([3, 2.5]);
          s.pen.strokeStyle = css("eve");
          s.pen.lineWidth = 1.1;
          s.pen.arc(toX(e.p[0]), toY(e.p[1]), radius / (2 * view.reach) * s.w, 0, 7);
          s.pen.stroke();
          s.pen.setLineDash([]);
        });
      });
      [0, 1].forEach(function (which) {
        var points = trail(which).map(flat);
        if (on) line(s.pen, points, "#ffffff", 3);
        line(s.pen, points, css(which ? "j" : "i"), 1.4, which ? [7, 3] : []);
        var vehicle = state.pair[which];
        if (!vehicle || !showNulls.checked) return;
        var ends = beam(vehicle).map(flat);
        if (on) line(s.pen, ends, "#ffffff", 2.6);
        line(s.pen, ends, css(which ? "j" : "i"), 1, [2, 3]);
        if (vehicle.p[2] > 1) nullEdge(s, vehicle, span, toX, toY, css(which ? "j" : "i"));
      });
      flight.eves.forEach(function (e) {
        if (e.t) { line(s.pen, [flat(e.p), flat(e.t)], css("eve"), 1); marker(s, "ring", flat(e.t), css("eve")); }
        marker(s, "cross", flat(e.p), css("eve"));
        s.names.push({ at: flat(e.p), text: e.n, colour: css("eve") });
      });
      flight.users.forEach(function (user) {
        marker(s, "square", flat(user.p), css("user"));
        s.names.push({ at: flat(user.p), text: user.n, colour: css("user") });
      });
      [0, 1].forEach(function (which) {
        var vehicle = state.pair[which];
        if (!vehicle) return;
        var at = flat(vehicle.p), colour = css(which ? "j" : "i"), dx = 17 * vehicle.axis[0], dy = -17 * vehicle.axis[1];
        axis(s, at, dx, dy, colour);
        marker(s, which ? "diamond" : "disc", at, colour);
        s.names.unshift({ at: at, text: ROLES[which] + ", " + vehicle.p[2].toFixed(0) + " m", colour: colour });
      });
      if (pointer) {
        line(s.pen, [[toX(pointer[0]), s.top], [toX(pointer[0]), s.top + s.h]], css("ink"), 0.6);
        line(s.pen, [[s.left, toY(pointer[1])], [s.left + s.w, toY(pointer[1])]], css("ink"), 0.6);
      }
      names(s);
    });
    axes(s, span.x, span.y, toX, toY, ["east (m)", "north (m)"]);
  }

  function drawSide(state) {
    var s = sheet(side), across = facing.value === "south" ? 0 : 1;
    var middle = across === 0 ? view.x : view.y;
    var span = [middle - view.reach, middle + view.reach], up = [-0.06 * home.top, home.top];
    // As wide as the view from above, and as tall as it must be.
    var toX = function (m) { return s.left + (m - span[0]) / (2 * view.reach) * s.w; };
    var toY = function (m) { return s.top + (up[1] - m) / (up[1] - up[0]) * s.h; };
    var flat = function (p) { return [toX(p[across]), toY(p[2])]; };
    var band = function (corners, low, high, colour, dashes) {
      var along = corners.map(function (c) { return c[across]; }), a = Math.min.apply(null, along), b = Math.max.apply(null, along);
      line(s.pen, [[toX(a), toY(low)], [toX(b), toY(low)], [toX(b), toY(high)], [toX(a), toY(high)]], colour, 1.6, dashes, true);
    };
    clip(s, function () {
      line(s.pen, [[s.left, toY(0)], [s.left + s.w, toY(0)]], css("muted"), 1);
      if (flight.area && flight.alt) band(flight.area, flight.alt[0], flight.alt[1], css("muted"), [8, 4]);
      flight.nofly.forEach(function (area) {
        band(area.c, area.f === null ? 0 : area.f, area.t === null ? home.top : area.t, css("fault"), [3, 3]);
      });
      [0, 1].forEach(function (which) {
        var vehicle = state.pair[which], colour = css(which ? "j" : "i");
        line(s.pen, trail(which).map(flat), colour, 1.4, which ? [7, 3] : []);
        if (!vehicle || !showNulls.checked) return;
        line(s.pen, beam(vehicle).map(flat), colour, 1, [2, 3]);
        // The null's cone: as wide across the axis as it is at that distance.
        var wide = Math.tan(NULL), u = [vehicle.axis[across], vehicle.axis[2]], far = Math.min(1.2 * home.top, home.reach);
        [1, -1].forEach(function (sign) {
          var tip = [vehicle.p[across] + sign * far * u[0], vehicle.p[2] + sign * far * u[1]];
          var flatLength = Math.hypot(u[0], u[1]) || 1, n = [-u[1] / flatLength * far * wide, u[0] / flatLength * far * wide];
          s.pen.beginPath();
          s.pen.moveTo(toX(vehicle.p[across]), toY(vehicle.p[2]));
          s.pen.lineTo(toX(tip[0] + n[0]), toY(tip[1] + n[1]));
          s.pen.lineTo(toX(tip[0] - n[0]), toY(tip[1] - n[1]));
          s.pen.closePath();
          s.pen.globalAlpha = 0.22;
          s.pen.fillStyle = colour;
          s.pen.fill();
          s.pen.globalAlpha = 1;
        });
      });
      flight.eves.forEach(function (e) {
        marker(s, "cross", flat(e.t || e.p), css("eve"));
        s.names.push({ at: flat(e.t || e.p), text: e.n, colour: css("eve") });
      });
      flight.users.forEach(function (user) {
        marker(s, "square", flat(user.p), css("user"));
        s.names.push({ at: flat(user.p), text: user.n, colour: css("user") });
      });
      [0, 1].forEach(function (which) {
        var vehicle = state.pair[which];
        if (!vehicle) return;
        var at = flat(vehicle.p), colour = css(which ? "j" : "i");
        var dx = toX(vehicle.axis[across]) - toX(0), dy = toY(vehicle.axis[2]) - toY(0);
        var scale = 17 * Math.hypot(vehicle.axis[across], vehicle.axis[2]) / (Math.hypot(dx, dy) || 1);
        axis(s, at, dx * scale, dy * scale, colour);
        marker(s, which ? "diamond" : "disc", at, colour);
        s.names.unshift({ at: at, text: ROLES[which], colour: colour });
      });
      names(s);
    });
    axes(s, span, up, toX, toY, [across === 0 ? "east (m), seen from the south" : "north (m), seen from the east", "up (m)"]);
  }

  function watts(w) { return w >= 1 ? w.toFixed(2) + " W" : w >= 1e-3 ? (w * 1e3).toPrecision(3) + " mW" : (w * 1e6).toPrecision(3) + " \u00b5W"; }

  function tell(state) {
    var rows = [];
    [0, 1].forEach(function (which) {
      var vehicle = state.pair[which], name = "vehicle " + ROLES[which];
      if (!vehicle) { rows.push([name, "nothing is known of it"]); return; }
      var where = phase(flight, which, t), text = (where ? where + ", " : "") + vehicle.mode + ", " + vehicle.p[2].toFixed(1) + " m up";
      rows.push([name, text]);
      rows.push([ROLES[which] + "'s radio", vehicle.watts > 0 ? "on, " + watts(vehicle.watts) + ", slot " + vehicle.slot
        : "silent: " + silence(flight, which, t)]);
    });
    var heard = state.heard, decibels = function (x) { return ", SINR " + x.toFixed(1).replace("-", "\u2212") + " dB"; };
    rows.push(["user", heard && state.user ? state.user.n + decibels(heard.user) : "none is served"]);
    rows.push(["strongest ear", heard && heard.which >= 0 ? flight.eves[heard.which].n + decibels(heard.eve) : "none"]);
    rows.push(["secrecy rate", heard ? heard.secrecy.toFixed(2) + " bit/s/Hz"
      + (flight.radio ? ", " + (heard.secrecy * flight.radio.bandwidth / 1e6).toFixed(2) + " Mbit/s" : "") : "0: nothing is sent"]);
    told.textContent = "";
    rows.forEach(function (row) {
      ["dt", "dd"].forEach(function (kind, k) {
        var element = document.createElement(kind);
        element.textContent = row[k];
        told.appendChild(element);
      });
    });
    if (!pointer) { pointed.textContent = "Point at the ground, or press the arrow keys on the map, for a place's latitude, longitude and rate."; return; }
    var text = "east " + pointer[0].toFixed(1) + " m, north " + pointer[1].toFixed(1) + " m";
    if (flight.origin) {
      var place = geodetic(flight.origin, [pointer[0], pointer[1], 0]);
      text += "; " + place[0].toFixed(6) + ", " + place[1].toFixed(6);
    }
    var rate = rateAt(flight, state, [pointer[0], pointer[1], 0]);
    text += rate === null ? "; nobody is served" : "; secrecy against a listener here " + rate.toFixed(2) + " bit/s/Hz";
    pointed.textContent = text + ".";
  }

  var asked = false;
  function draw() {
    asked = false;
    slider.value = String(t);
    var label = t.toFixed(1) + " s";
    now.textContent = label + " of " + end.toFixed(1) + " s";
    slider.setAttribute("aria-valuetext", label);
    var state = stateAt(flight, t);
    drawPlan(state);
    drawSide(state);
    tell(state);
  }
  function redraw() { if (!asked) { asked = true; requestAnimationFrame(draw); } }

  function go(to) { t = Math.max(begin, Math.min(end, to)); redraw(); }
  function run(on) {
    playing = on;
    play.textContent = on ? "Pause" : "Play";
    if (on) { if (t >= end) t = begin; before = performance.now(); requestAnimationFrame(tick); }
  }
  function tick(stamp) {
    if (!playing) return;
    var passed = Math.max(0, stamp - before) / 1000;
    before = stamp;
    t = Math.min(end, t + passed * Number(speed.value));
    draw();
    if (t >= end) run(false); else requestAnimationFrame(tick);
  }
  function zoom(by, x, y) {
    var reach = Math.max(2, Math.min(3 * home.reach, view.reach * by)), k = reach / view.reach;
    view = { x: x + (view.x - x) * k, y: y + (view.y - y) * k, reach: reach };
    redraw();
  }
  function whole() { view = { x: home.x, y: home.y, reach: home.reach }; redraw(); }
  function place(event) {
    var box = plan.getBoundingClientRect(), v = plan.view, x = event.clientX - box.left, y = event.clientY - box.top;
    if (!v || x < v.s.left || x > v.s.left + v.s.w || y < v.s.top || y > v.s.top + v.s.h) return null;
    return [v.span.x[0] + (x - v.s.left) / v.s.w * 2 * view.reach, v.span.y[1] - (y - v.s.top) / v.s.h * 2 * view.reach];
  }

  slider.min = String(begin);
  slider.max = String(end);
  slider.addEventListener("input", function () { run(false); go(Number(slider.value)); });
  play.addEventListener("click", function () { run(!playing); });
  [showRates, showNulls, facing].forEach(function (control) { control.addEventListener("change", redraw); });
  at("closer").addEventListener("click", function () { zoom(0.7, view.x, view.y); });
  at("farther").addEventListener("click", function () { zoom(1 / 0.7, view.x, view.y); });
  at("whole").addEventListener("click", whole);
  at("marks").addEventListener("click", function (event) {
    var to = event.target.getAttribute("data-at");
    if (to !== null) { run(false); go(Number(to)); }
  });
  plan.addEventListener("keydown", function (event) {
    var move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (move) {
      var from = pointer || [view.x, view.y], by = view.reach / (event.shiftKey ? 5 : 50);
      pointer = [from[0] + move[0] * by, from[1] + move[1] * by];
    } else if (event.key === "+" || event.key === "=") zoom(0.7, (pointer || [view.x])[0], (pointer || [0, view.y])[1]);
    else if (event.key === "-") zoom(1 / 0.7, view.x, view.y);
    else if (event.key === "0") whole();
    else if (event.key === "Escape") pointer = null;
    else if (event.key === " ") run(!playing);
    else return;
    event.preventDefault();
    redraw();
  });
  // Fingers and mice alike: one drags, two zoom.
  var down = {};
  plan.addEventListener("pointerdown", function (event) {
    down[event.pointerId] = [event.clientX, event.clientY];
    plan.setPointerCapture(event.pointerId);
  });
  plan.addEventListener("pointermove", function (event) {
    var held = Object.keys(down), was = down[event.pointerId];
    if (was && held.length === 1) {
      var metres = 2 * view.reach / plan.view.s.w;
      view.x -= (event.clientX - was[0]) * metres;
      view.y += (event.clientY - was[1]) * metres;
    } else if (was && held.length === 2) {
      var other = down[held[0] === String(event.pointerId) ? held[1] : held[0]];
      var length = function (p) { return Math.hypot(p[0] - other[0], p[1] - other[1]) || 1; };
      zoom(length(was) / length([event.clientX, event.clientY]), view.x, view.y);
    }
    if (was) down[event.pointerId] = [event.clientX, event.clientY];
    pointer = place(event);
    redraw();
  });
  ["pointerup", "pointercancel"].forEach(function (name) {
    plan.addEventListener(name, function (event) { delete down[event.pointerId]; });
  });
  plan.addEventListener("pointerleave", function (event) { if (event.pointerType === "mouse") { pointer = null; redraw(); } });
  plan.addEventListener("wheel", function (event) {
    var p = place(event);
    // A wheel zooms where the keyboard's own focus is, or with Ctrl; elsewhere it goes on turning the page.
    if (!p || !(event.ctrlKey || document.activeElement === plan)) return;
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.0015), p[0], p[1]);
  }, { passive: false });
  root.addEventListener("keydown", function (event) {
    if (event.target === plan || /^(SELECT|INPUT)$/.test(event.target.tagName)) return;
    var by = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10 }[event.key];
    if (by) { run(false); go(t + by); event.preventDefault(); }
  });
  window.addEventListener("resize", redraw);
  if (window.matchMedia) matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  // The first instant at which somebody is served says more than the ground before the take-off.
  flight.t.some(function (time) { if (stateAt(flight, time).user) { t = time; return true; } return false; });
  draw();
})();
