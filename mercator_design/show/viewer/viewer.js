/* The replay viewer: shows the trace of an experiment on a canvas. No libraries, no requests.
 *
 * `MercatorReplay.mount(element, replays)` shows one replay, or several side by side with one clock. A replay is what
 * `show/replay.py` writes: a header in JSON and packed arrays. Lengths are metres, angles radians, times control cycles.
 */
"use strict";

const MercatorReplay = (() => {
  const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16, 32, 64];
  const TRAIL = 100; // cycles
  const FOLLOWING = 2.5; // zoom while a robot is followed
  const NOTHING = 255; // in the proximity array: nothing in sight
  const UNKNOWN = "#8a949c"; // colour of a robot whose control software is not known, or no part of it active
  const MORE = 24; // height of what tells that there is more below [pixels]
  const MARKS = ["", "", "✓", "✗"]; // of nodes that are not ticked, run, succeed, fail: the numbers of tree/control.py
  const KINDS = { disc: 0, rectangle: 1, halfPlane: 2, ring: 3, polygon: 4 }; // of missions/floor.py

  /* ---- Data ---- */

  function bytesOf(base64) {
    const text = atob(base64);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return bytes;
  }

  async function inflate(bytes) {
    if (typeof DecompressionStream === "undefined") return fflateUnzlib(bytes);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /** The arrays of a replay by name. `delta16`: planes of low and high bytes of the differences along each row. */
  function unpack(bytes, layout) {
    const arrays = {};
    let at = 0;
    for (const { name, kind, rows, columns } of layout) {
      const n = rows * columns;
      if (kind === "delta16") {
        const values = new Int16Array(n);
        for (let r = 0; r < rows; r++) {
          let value = 0;
          for (let c = 0; c < columns; c++) {
            const k = r * columns + c;
            value = (value + bytes[at + k] + (bytes[at + n + k] << 8)) & 0xffff;
            values[k] = value;
          }
        }
        arrays[name] = values;
        at += 2 * n;
      } else {
        arrays[name] = bytes.subarray(at, at + n);
        at += n;
      }
    }
    return arrays;
  }

  /** One experiment: what its robots did in each cycle. */
  class Replay {
    static async load(source) {
      const replay = new Replay();
      Object.assign(replay, source.header);
      replay.arrays = unpack(await inflate(bytesOf(source.data)), source.header.layout);
      return replay;
    }

    /** x, y and heading of a robot, between cycles too. */
    pose(robot, cycle) {
      const before = Math.min(Math.floor(cycle), this.cycles);
      const after = Math.min(before + 1, this.cycles);
      const part = cycle - before;
      const a = robot * (this.cycles + 1) + before;
      const b = robot * (this.cycles + 1) + after;
      const { x, y, heading } = this.arrays;
      let turn = heading[b] - heading[a];
      turn -= 65536 * Math.round(turn / 65536);
      return [
        this.poses.origin[0] + this.poses.unit * (x[a] + part * (x[b] - x[a])),
        this.poses.origin[1] + this.poses.unit * (y[a] + part * (y[b] - y[a])),
        ((heading[a] + part * turn) * Math.PI) / 32768,
      ];
    }

    /** The state of a robot after the cycle that ends at `cycle`; at the start the initial state. */
    state(robot, cycle) {
      const c = Math.ceil(cycle) - 1;
      return c < 0 ? 0 : this.arrays.state[robot * this.cycles + Math.min(c, this.cycles - 1)];
    }

    /** The colour of a robot in a state. */
    colour(robot, state) {
      const machine = this.machine(robot);
      return (machine && machine.colours[state]) || UNKNOWN;
    }

    /** Whether a robot has stopped working in the cycle that ends at `cycle`, or before. */
    hasFailed(robot, cycle) {
      return Boolean(this.stops) && cycle > 0 && Math.ceil(cycle) - 1 >= this.stops[robot];
    }

    /** What each node of a robot's tree or network did in a cycle; null if it is not known. */
    activity(robot, cycle) {
      return cycle > 0 ? this.readings("activity", robot, cycle, this.activityNodes) : null;
    }

    /** What a robot has set in a cycle, by the name of the output; null if no module of its control software sets it. */
    output(name, robot, cycle) {
      const machine = this.machine(robot);
      if (!machine || !machine.sets.includes(name) || !this.arrays[name]) return null;
      return cycle > 0 ? this.reading(name, robot, cycle) : 0;
    }

    /** The state machine of a robot: the names of its states, and its diagram; null if it is not known. */
    machine(robot) {
      return this.machines.length ? this.machines[this.machineOf[robot]] : null;
    }

    /** How many cycles a robot has been in its state. */
    age(robot, cycle) {
      const now = Math.max(0, Math.ceil(cycle));
      const state = this.state(robot, now);
      let since = now;
      while (since > 0 && this.state(robot, since - 1) === state) since--;
      return now - since;
    }

    /** The numbers of a robot after a cycle, so many for each; null if they are not known. */
    readings(name, robot, cycle, width) {
      const array = this.arrays[name];
      if (!array) return null;
      const c = Math.min(Math.max(Math.ceil(cycle) - 1, 0), this.cycles - 1);
      const at = (robot * this.cycles + c) * width;
      return array.subarray(at, at + width);
    }

    reading(name, robot, cycle) {
      const found = this.readings(name, robot, cycle, 1);
      return found && found[0];
    }

    /** The score if the experiment had ended at a cycle, as last computed. */
    scoreAt(cycle) {
      const { cycles, scores } = this.curve;
      let found = null;
      for (let k = 0; k < cycles.length && cycles[k] <= cycle + 1e-9; k++) found = scores[k];
      return found;
    }
  }

  /* ---- Drawing ---- */

  const css = (element, name) => getComputedStyle(element).getPropertyValue(name).trim();
  const rgb = ([r, g, b]) => `rgb(${Math.round(r)},${Math.round(g)},${Math.round(b)})`;

  /** Pixels of a canvas in a CSS pixel. */
  const density = () => window.devicePixelRatio || 1;

  /** Give a canvas as many pixels as its place on the screen has. */
  function fit(canvas) {
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((n) => Math.max(1, Math.round(n * density())));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  }

  function outline(context, points) {
    points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
  }

  /** Fill an outline, and draw its border. */
  function area(context, points, fill, stroke = "transparent") {
    context.beginPath();
    outline(context, points);
    [context.fillStyle, context.strokeStyle] = [fill, stroke];
    context.fill();
    context.stroke();
  }

  /** The zones of a floor as they are at a cycle. */
  class Floor {
    constructor(floor) {
      this.floor = floor;
      this.start = floor.zones.map((row) => [...row]);
      this.zones = this.start.map((row) => [...row]);
      this.done = 0; // changes that `zones` has
      if (floor.image) {
        this.image = new Image();
        this.image.src = floor.image;
      }
    }

    /** Bring `zones` to a cycle. */
    seek(cycle) {
      const { changes } = this.floor;
      if (this.done && changes[this.done - 1][0] > cycle) {
        this.zones = this.start.map((row) => [...row]);
        this.done = 0;
      }
      while (this.done < changes.length && changes[this.done][0] <= cycle) {
        const [, row, values] = changes[this.done++];
        this.zones[row] = values;
      }
    }

    draw(context, reach) {
      const { background, extent, vertices } = this.floor;
      context.fillStyle = rgb(background);
      context.fillRect(-reach, -reach, 2 * reach, 2 * reach);
      if (this.image && this.image.complete) {
        const [left, bottom, width, height] = extent;
        context.save();
        context.imageSmoothingEnabled = false;
        context.translate(left, bottom + height);
        context.scale(1, -1);
        context.drawImage(this.image, 0, 0, width, height);
        context.restore();
      }
      for (const [kind, x, y, p, q, angle, ...colour] of this.zones) {
        context.fillStyle = rgb(colour);
        context.beginPath();
        if (kind === KINDS.disc) context.arc(x, y, p, 0, 2 * Math.PI);
        else if (kind === KINDS.ring) {
          context.arc(x, y, p, 0, 2 * Math.PI);
          context.arc(x, y, q, 0, 2 * Math.PI, true);
        } else if (kind === KINDS.polygon) outline(context, vertices.slice(x, y));
        else {
          context.save();
          context.translate(x, y);
          if (kind === KINDS.rectangle) {
            context.rotate(angle);
            context.rect(-p, -q, 2 * p, 2 * q);
          } else {
            context.rotate(Math.atan2(q, p));
            context.rect(0, -reach, reach, 2 * reach);
          }
          context.restore();
        }
        context.fill();
      }
    }
  }

  /** The arena on a canvas, with its robots at a cycle. */
  class Stage {
    constructor(canvas, replay, options) {
      this.canvas = canvas;
      this.replay = replay;
      this.options = options; // shared by all scenes: what is shown, and the chosen robot
      this.floor = new Floor(replay.floor);
      this.zoom = 1;
      this.pan = [0, 0];
      const points = [...replay.arena.frame, ...(replay.arena.room || []), ...replay.arena.lights.map((l) => [l.x, l.y])];
      const xs = points.map((p) => p[0]);
      const ys = points.map((p) => p[1]);
      this.low = [Math.min(...xs), Math.min(...ys)];
      this.high = [Math.max(...xs), Math.max(...ys)];
      this.reach = 4 * Math.max(1, ...xs.map(Math.abs), ...ys.map(Math.abs));
      this.segments = this.wallSegments();
      this.presence = null;
    }

    wallSegments() {
      const closed = (points) => points.map((p, k) => [...p, ...points[(k + 1) % points.length]]);
      const { walls, room, obstacles } = this.replay.arena;
      const seen = obstacles.filter((box) => box.hidesFromLidar).map((box) => box.corners);
      return [...(walls ? [closed(walls)] : []), ...(room ? [closed(room)] : []), ...seen.map(closed)].flat();
    }

    /** Pixels of a metre, and where the arena's middle is on the canvas. */
    view(cycle) {
      const { width, height } = this.canvas;
      const size = [this.high[0] - this.low[0], this.high[1] - this.low[1]];
      const scale = this.zoom * 0.94 * Math.min(width / size[0], height / size[1]);
      const { follow, robot } = this.options;
      const middle =
        follow && robot !== null && robot < this.replay.robots
          ? this.replay.pose(robot, cycle)
          : [0.5 * (this.low[0] + this.high[0]) + this.pan[0], 0.5 * (this.low[1] + this.high[1]) + this.pan[1]];
      return { scale, middle };
    }

    /** Metres of a point of the canvas [CSS pixels]. */
    locate(px, py, cycle) {
      const ratio = density();
      const { scale, middle } = this.view(cycle);
      return [
        middle[0] + (px * ratio - 0.5 * this.canvas.width) / scale,
        middle[1] - (py * ratio - 0.5 * this.canvas.height) / scale,
      ];
    }

    robotAt(px, py, cycle) {
      const [x, y] = this.locate(px, py, cycle);
      const { scale } = this.view(cycle);
      let found = null;
      let nearest = Math.max(1.3 * this.replay.body.radius, (14 * density()) / scale);
      for (let i = 0; i < this.replay.robots; i++) {
        const [a, b] = this.replay.pose(i, cycle);
        const distance = Math.hypot(a - x, b - y);
        if (distance < nearest) [found, nearest] = [i, distance];
      }
      return found;
    }

    draw(cycle) {
      const { canvas, replay, options } = this;
      fit(canvas);
      const context = canvas.getContext("2d");
      const { scale, middle } = this.view(cycle);
      this.pixel = 1 / scale;
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.fillStyle = css(canvas, "--outside");
      context.fillRect(0, 0, canvas.width, canvas.height);
      context.setTransform(
        scale, 0, 0, -scale, 0.5 * canvas.width - scale * middle[0], 0.5 * canvas.height + scale * middle[1]
      );
      this.drawFloor(context, cycle);
      if (options.presence) this.drawPresence(context);
      if (options.map && replay.map) this.drawMap(context, cycle);
      if (options.trails) this.drawTrails(context, cycle);
      this.drawArena(context);
      if (options.neighbours) this.drawNeighbours(context, cycle);
      if (options.proximity) this.drawProximity(context, cycle);
      if (options.lidar && options.robot !== null) this.drawLidar(context, cycle);
      for (let i = 0; i < replay.robots; i++) this.drawRobot(context, i, cycle);
      if (options.zones) this.drawZoneNames(context);
    }

    drawFloor(context, cycle) {
      this.floor.seek(Math.ceil(cycle));
      context.save();
      context.beginPath();
      outline(context, this.replay.arena.frame);
      context.clip();
      this.floor.draw(context, this.reach);
      context.restore();
    }

    drawArena(context) {
      const { walls, room, obstacles, lights } = this.replay.arena;
      const wall = css(this.canvas, "--wall");
      context.lineJoin = "miter";
      context.lineWidth = Math.max(0.01, 2 * this.pixel);
      if (walls) area(context, walls, "transparent", wall);
      context.setLineDash([0.05, 0.03]);
      if (room) area(context, room, "transparent", wall);
      context.setLineDash([]);
      for (const { corners } of obstacles) area(context, corners, css(this.canvas, "--obstacle"));
      for (const { x, y, isOn } of lights) {
        context.beginPath();
        context.arc(x, y, 7 * this.pixel * density(), 0, 2 * Math.PI);
        context.fillStyle = isOn ? "#ffd23f" : "transparent";
        context.strokeStyle = "#000";
        context.lineWidth = this.pixel;
        context.fill();
        context.stroke();
      }
    }

    drawRobot(context, i, cycle) {
      const { replay, options } = this;
      const [x, y, heading] = replay.pose(i, cycle);
      const state = replay.state(i, cycle);
      context.save();
      context.translate(x, y);
      context.rotate(heading);
      const isChosen = i === options.robot;
      context.lineWidth = (isChosen ? 3.5 : 1) * this.pixel * density();
      const hasFailed = replay.hasFailed(i, cycle);
      area(context, replay.body.outline, hasFailed ? UNKNOWN : replay.colour(i, state), isChosen ? css(this.canvas, "--selected") : "#000");
      const r = replay.body.radius;
      context.lineWidth = this.pixel;
      area(context, [[0.75 * r, 0], [-0.35 * r, 0.42 * r], [-0.12 * r, 0], [-0.35 * r, -0.42 * r]], "#fff", "#000");
      const led = replay.output("led_colour", i, cycle);
      if (led !== null) {
        context.beginPath();
        context.arc(-0.6 * r, 0, 0.22 * r, 0, 2 * Math.PI);
        [context.fillStyle, context.strokeStyle] = [replay.ledColours[led].colour, "#000"];
        context.fill();
        context.stroke();
      }
      if (hasFailed) {
        context.beginPath();
        for (const side of [-1, 1]) {
          context.moveTo(-0.6 * r, -0.6 * r * side);
          context.lineTo(0.6 * r, 0.6 * r * side);
        }
        [context.strokeStyle, context.lineWidth] = ["#c00", 2.5 * this.pixel * density()];
        context.stroke();
      }
      context.restore();
      if (isChosen || r / this.pixel > 26 * density()) {
        this.text(context, replay.names[i], x, y - 1.5 * r, 11);
      }
    }

    text(context, words, x, y, size) {
      const ratio = density();
      context.save();
      context.translate(x, y);
      context.scale(this.pixel, -this.pixel);
      context.font = `600 ${size * ratio}px system-ui, sans-serif`;
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.lineJoin = "round";
      context.lineWidth = 3 * ratio;
      context.strokeStyle = "rgba(255,255,255,0.9)";
      context.fillStyle = "#111";
      context.strokeText(words, 0, 0);
      context.fillText(words, 0, 0);
      context.restore();
    }

    drawZoneNames(context) {
      for (const { name, x, y } of this.replay.zones) {
        const short = name.length > 40 ? `${name.slice(0, 39)}…` : name;
        this.text(context, short, x, y, 12);
      }
    }

    drawTrails(context, cycle) {
      const { replay, options } = this;
      context.lineWidth = 1.5 * this.pixel * density();
      const begin = Math.max(0, Math.ceil(cycle) - TRAIL);
      for (let i = 0; i < replay.robots; i++) {
        if (options.robot !== null && options.follow && options.robot !== i) continue;
        for (let c = begin; c < cycle; c += 2) {
          const [x, y] = replay.pose(i, c);
          const [u, v] = replay.pose(i, Math.min(c + 2, cycle));
          context.globalAlpha = 0.15 + (0.75 * (c - begin)) / TRAIL;
          context.strokeStyle = replay.colour(i, replay.state(i, c + 1));
          context.beginPath();
          context.moveTo(x, y);
          context.lineTo(u, v);
          context.stroke();
        }
      }
      context.globalAlpha = 1;
    }

    /** How often each cell of the arena had a robot's centre, over the whole experiment. */
    drawPresence(context) {
      this.presence ??= presenceImage(this);
      const { image, low, width, height } = this.presence;
      context.save();
      context.imageSmoothingEnabled = true;
      context.translate(low[0], low[1] + height);
      context.scale(1, -1);
      context.drawImage(image, 0, 0, width, height);
      context.restore();
    }

    /** The pieces of walls that the robots' lidars have seen so far: the ends of each, and the cycle that saw it first. */
    drawMap(context, cycle) {
      context.strokeStyle = css(this.canvas, "--mapped");
      context.lineWidth = Math.max(0.015, 2 * this.pixel * density());
      context.beginPath();
      for (const [x, y, u, v, first] of this.replay.map) {
        if (first > cycle) break;
        context.moveTo(x, y);
        context.lineTo(u, v);
      }
      context.stroke();
    }

    drawNeighbours(context, cycle) {
      const { replay, options } = this;
      const bytes = Math.ceil(replay.robots / 8);
      if (!replay.arrays.seen) return;
      context.beginPath();
      for (let i = 0; i < replay.robots; i++) {
        if (options.robot !== null && options.robot !== i) continue;
        const bits = replay.readings("seen", i, cycle, bytes);
        const [x, y] = replay.pose(i, cycle);
        for (let j = 0; j < replay.robots; j++) {
          if (!((bits[j >> 3] >> (j & 7)) & 1)) continue;
          const [u, v] = replay.pose(j, cycle);
          context.moveTo(x, y);
          context.lineTo(u, v);
        }
      }
      for (const [name, width] of [["--edge", 3.5], ["--link", 1.6]]) {
        context.strokeStyle = css(this.canvas, name); // on light and on dark floors
        context.lineWidth = width * this.pixel * density();
        context.stroke();
      }
    }

    drawProximity(context, cycle) {
      const { replay, options } = this;
      if (!replay.proximity || !replay.arrays.proximity) return;
      const { angles, places, range, steps } = replay.proximity;
      const [ray, hit] = ["--ray", "--hit"].map((name) => css(this.canvas, name));
      context.lineWidth = 1.2 * this.pixel * density();
      for (let i = 0; i < replay.robots; i++) {
        if (options.robot !== null && options.robot !== i) continue;
        const [x, y, heading] = replay.pose(i, cycle);
        const values = replay.readings("proximity", i, cycle, angles.length);
        const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
        angles.forEach((angle, k) => {
          const isClear = values[k] === NOTHING;
          const length = isClear ? range : (values[k] / steps) * range;
          const [a, b] = [x + cos * places[k][0] - sin * places[k][1], y + sin * places[k][0] + cos * places[k][1]];
          context.globalAlpha = isClear ? 0.18 : 0.9;
          context.strokeStyle = isClear ? ray : hit;
          context.beginPath();
          context.moveTo(a, b);
          context.lineTo(a + length * Math.cos(heading + angle), b + length * Math.sin(heading + angle));
          context.stroke();
        });
      }
      context.globalAlpha = 1;
    }

    /** What an exact lidar on the chosen robot would see now: walls, high obstacles and the heads of other robots. */
    drawLidar(context, cycle) {
      const { replay, options } = this;
      if (!replay.lidar) return;
      const [x, y, heading] = replay.pose(options.robot, cycle);
      const heads = [];
      for (let i = 0; i < replay.robots; i++) if (i !== options.robot) heads.push(replay.pose(i, cycle));
      context.fillStyle = css(this.canvas, "--hit");
      const { samples, range, headRadius } = replay.lidar;
      const dot = 1.5 * this.pixel * density();
      for (let k = 0; k < samples; k++) {
        const angle = heading + (2 * Math.PI * k) / samples;
        const [dx, dy] = [Math.cos(angle), Math.sin(angle)];
        let nearest = range;
        for (const [a, b, c, d] of this.segments) nearest = Math.min(nearest, hitSegment(x, y, dx, dy, a, b, c, d));
        for (const [a, b] of heads) nearest = Math.min(nearest, hitDisc(x, y, dx, dy, a, b, headRadius));
        if (nearest < range) context.fillRect(x + nearest * dx - dot, y + nearest * dy - dot, 2 * dot, 2 * dot);
      }
    }
  }

  function hitSegment(x, y, dx, dy, a, b, c, d) {
    const [ex, ey] = [c - a, d - b];
    const turn = dx * ey - dy * ex;
    if (turn === 0) return Infinity;
    const along = ((a - x) * ey - (b - y) * ex) / turn;
    const across = ((a - x) * dy - (b - y) * dx) / turn;
    return along >= 0 && across >= 0 && across <= 1 ? along : Infinity;
  }

  function hitDisc(x, y, dx, dy, a, b, radius) {
    const along = (a - x) * dx + (b - y) * dy;
    const beside = (a - x) * dy - (b - y) * dx;
    if (along <= 0 || Math.abs(beside) >= radius) return Infinity;
    return along - Math.sqrt(radius * radius - beside * beside);
  }

  function presenceImage(stage) {
    const { replay, low, high } = stage;
    const cell = Math.max(high[0] - low[0], high[1] - low[1]) / 64;
    const columns = Math.ceil((high[0] - low[0]) / cell);
    const rows = Math.ceil((high[1] - low[1]) / cell);
    const counts = new Float64Array(rows * columns);
    for (let i = 0; i < replay.robots; i++) {
      for (let c = 0; c <= replay.cycles; c++) {
        const [x, y] = replay.pose(i, c);
        const column = Math.floor((x - low[0]) / cell);
        const row = Math.floor((high[1] - y) / cell);
        if (row >= 0 && row < rows && column >= 0 && column < columns) counts[row * columns + column]++;
      }
    }
    const maxCount = Math.max(...counts) || 1;
    const image = document.createElement("canvas");
    [image.width, image.height] = [columns, rows];
    const context = image.getContext("2d");
    const pixels = context.createImageData(columns, rows);
    counts.forEach((count, k) => {
      const share = Math.sqrt(count / maxCount);
      pixels.data.set([213 - 60 * share, 94 * (1 - share), 40 + 80 * share, count ? 40 + 200 * share : 0], 4 * k);
    });
    context.putImageData(pixels, 0, 0);
    return { image, low: [low[0], high[1] - rows * cell], width: columns * cell, height: rows * cell };
  }

  /* ---- The timeline: the score so far, and the states of all robots ---- */

  class Timeline {
    constructor(canvas, replay, options) {
      this.canvas = canvas;
      this.replay = replay;
      this.options = options;
      this.drawn = null;
    }

    get curveHeight() {
      return 44 * density();
    }

    cycleAt(px) {
      const share = px / Math.max(1, this.canvas.clientWidth);
      return Math.min(Math.max(share, 0), 1) * this.replay.cycles;
    }

    draw(cycle) {
      fit(this.canvas);
      const ratio = density();
      const { width, height } = this.canvas;
      const key = `${width}x${height} ${this.options.robot} ${css(this.canvas, "--panel")}`;
      if (this.drawn !== key) {
        this.base = document.createElement("canvas");
        [this.base.width, this.base.height] = [width, height];
        this.drawBase(this.base.getContext("2d"), width, height, ratio);
        this.drawn = key;
      }
      const context = this.canvas.getContext("2d");
      context.drawImage(this.base, 0, 0);
      const x = (cycle / this.replay.cycles) * width;
      context.fillStyle = css(this.canvas, "--cursor");
      context.fillRect(Math.min(Math.max(x - ratio, 0), width - 2 * ratio), 0, 2 * ratio, height);
    }

    drawBase(context, width, height, ratio) {
      const { replay } = this;
      context.fillStyle = css(this.canvas, "--panel");
      context.fillRect(0, 0, width, height);
      const { cycles, scores } = replay.curve;
      if (scores.length) {
        const low = Math.min(0, ...scores);
        const high = Math.max(...scores, low + 1e-9);
        const top = 14 * ratio;
        const place = (k) => [
          (cycles[k] / replay.cycles) * width,
          top + (this.curveHeight - top - 2 * ratio) * (1 - (scores[k] - low) / (high - low)),
        ];
        context.beginPath();
        scores.forEach((_, k) => (k ? context.lineTo(...place(k)) : context.moveTo(...place(k))));
        context.strokeStyle = css(this.canvas, "--curve");
        context.lineWidth = 1.6 * ratio;
        context.stroke();
        context.fillStyle = css(this.canvas, "--faint");
        context.font = `${10 * ratio}px system-ui, sans-serif`;
        context.textBaseline = "top";
        context.fillText(`score so far: ${figure(low)} to ${figure(high)}`, 3 * ratio, 2 * ratio);
      }
      const row = (height - this.curveHeight) / replay.robots;
      for (let i = 0; i < replay.robots; i++) {
        const y = this.curveHeight + i * row;
        let since = 0;
        for (let c = 1; c <= replay.cycles; c++) {
          if (c < replay.cycles && replay.state(i, c + 1) === replay.state(i, since + 1)) continue;
          context.fillStyle = replay.colour(i, replay.state(i, since + 1));
          const [a, b] = [(since / replay.cycles) * width, (c / replay.cycles) * width];
          context.fillRect(a, y, Math.max(b - a, 0.5), Math.max(row - (row > 3 * ratio ? ratio : 0), 0.5));
          since = c;
        }
        if (i === this.options.robot) {
          context.strokeStyle = css(this.canvas, "--selected");
          context.lineWidth = 2 * ratio;
          context.strokeRect(ratio, y, width - 2 * ratio, row);
        }
      }
    }
  }

  const figure = (value) => (value === null ? "–" : String(Number(value.toPrecision(4))));

  /* ---- The page ---- */

  function make(tag, attributes = {}, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name === "on") for (const [event, handler] of Object.entries(value)) element.addEventListener(event, handler);
      else if (name === "text") element.textContent = value;
      else if (value !== null && value !== false) element.setAttribute(name, value === true ? "" : value);
    }
    element.append(...children);
    return element;
  }

  /** One replay on the page: its stage, its timeline and what is said of one robot. */
  class Scene {
    constructor(replay, options, player) {
      this.replay = replay;
      this.options = options;
      this.player = player;
      const canvas = make("canvas", { class: "mr-stage", tabindex: "0", role: "img", "aria-label": `${replay.title}: the arena` });
      const timeline = make("canvas", { class: "mr-timeline", role: "img", "aria-label": "Score so far and states of the robots over time" });
      this.stage = new Stage(canvas, replay, options);
      this.timeline = new Timeline(timeline, replay, options);
      this.status = make("span", { class: "mr-status" });
      this.panel = make("aside", { class: "mr-panel", "aria-label": "Chosen robot" });
      this.element = make(
        "section",
        { class: "mr-scene" },
        make("header", {}, make("h2", { text: replay.title }), make("p", { text: replay.subtitle }), this.status),
        make("div", { class: "mr-body" }, canvas, this.panel),
        this.legend(),
        timeline
      );
      this.facts = make("dl", {});
      this.diagram = make("button", {
        type: "button", class: "mr-diagram", "aria-expanded": "false",
        on: { click: () => this.diagram.setAttribute("aria-expanded", String(this.panel.classList.toggle("mr-large"))) },
      });
      this.more = make("p", { class: "mr-more", text: "↓ more", hidden: true, "aria-hidden": "true" });
      this.panel.append(this.facts, this.diagram, this.more);
      this.panel.addEventListener("scroll", () => this.reveal(this.revealed));
      this.listen(canvas, timeline);
    }

    legend() {
      const { machines, names } = this.replay;
      const lists = machines.map(({ states, colours, architecture }, m) => {
        const robots = names.filter((_, robot) => this.replay.machineOf[robot] === m);
        const items = states.flatMap((name, k) => (colours[k] || k === 0 ? [make("li", {}, make("i", { style: `background:${colours[k] || UNKNOWN}` }), make("span", { text: name }))] : []));
        const whose = machines.length > 1 ? [make("li", { class: "mr-whose", text: `${robots.join(", ")}:` })] : [];
        return make("ul", { class: "mr-legend", "aria-label": architecture === "tree" ? "Actions" : "States" }, ...whose, ...items);
      });
      return make("div", {}, ...lists);
    }

    /** Show the diagram of a robot's machine. */
    showMachine(machine) {
      if (this.shownMachine === machine) return;
      this.shownMachine = machine;
      this.diagram.replaceChildren();
      if (!machine) return;
      this.diagram.title = `${machine.noun}: larger or smaller`;
      const parsed = new DOMParser().parseFromString(machine.diagram, "image/svg+xml");
      this.diagram.append(document.importNode(parsed.documentElement, true));
    }

    listen(canvas, timeline) {
      const pointers = new Map();
      let moved = 0;
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
        moved = 0;
      });
      canvas.addEventListener("pointermove", (event) => {
        if (!pointers.has(event.pointerId)) return;
        const [x, y] = pointers.get(event.pointerId);
        const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
        if (others.length) {
          const [a, b] = others[0];
          const ratio = Math.hypot(event.offsetX - a, event.offsetY - b) / Math.max(1, Math.hypot(x - a, y - b));
          this.zoomAt(ratio, 0.5 * (event.offsetX + a), 0.5 * (event.offsetY + b));
        } else {
          const scale = this.stage.view(this.player.cycle).scale / density();
          this.stage.pan[0] -= (event.offsetX - x) / scale;
          this.stage.pan[1] += (event.offsetY - y) / scale;
          moved += Math.abs(event.offsetX - x) + Math.abs(event.offsetY - y);
        }
        pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
        this.player.redraw();
      });
      const lift = (event) => {
        if (pointers.delete(event.pointerId) && event.type === "pointerup" && moved < 5 && !pointers.size) {
          this.player.choose(this.stage.robotAt(event.offsetX, event.offsetY, this.player.cycle));
        }
      };
      canvas.addEventListener("pointerup", lift);
      canvas.addEventListener("pointercancel", lift);
      canvas.addEventListener(
        "wheel",
        (event) => {
          event.preventDefault();
          this.zoomAt(Math.exp(-0.0015 * event.deltaY), event.offsetX, event.offsetY);
        },
        { passive: false }
      );
      const seek = (event) => event.buttons && this.player.seek(this.timeline.cycleAt(event.offsetX));
      timeline.addEventListener("pointerdown", (event) => {
        timeline.setPointerCapture(event.pointerId);
        seek(event);
      });
      timeline.addEventListener("pointermove", seek);
    }

    zoomAt(ratio, px, py) {
      const { cycle } = this.player;
      const before = this.stage.locate(px, py, cycle);
      this.stage.zoom = Math.min(Math.max(this.stage.zoom * ratio, 0.5), 40);
      const after = this.stage.locate(px, py, cycle);
      if (!this.options.follow) {
        this.stage.pan[0] += before[0] - after[0];
        this.stage.pan[1] += before[1] - after[1];
      }
      this.player.redraw();
    }

    draw(cycle) {
      this.say(Math.min(cycle, this.replay.cycles)); // first: the panel takes width from the stage
      this.stage.draw(Math.min(cycle, this.replay.cycles));
      this.timeline.draw(Math.min(cycle, this.replay.cycles));
      const score = this.replay.scoreAt(cycle);
      const time = Math.min(cycle, this.replay.cycles) * this.replay.period;
      this.status.textContent = `${time.toFixed(1)} s of ${(this.replay.cycles * this.replay.period).toFixed(0)} s` + (score === null ? "" : `, score so far ${figure(score)}`);
    }

    /** What is known of the chosen robot. */
    say(cycle) {
      const { robot } = this.options;
      this.panel.hidden = robot === null || robot >= this.replay.robots;
      if (this.panel.hidden) return;
      const { replay } = this;
      const [x, y, heading] = replay.pose(robot, cycle);
      const state = replay.state(robot, cycle);
      const machine = replay.machine(robot);
      this.showMachine(machine);
      const degrees = ((((heading * 180) / Math.PI) % 360) + 360) % 360;
      const facts = [
        ["Robot", replay.names[robot]],
        ...(replay.hasFailed(robot, cycle) ? [["Failed", `at ${((replay.stops[robot] + 1) * replay.period).toFixed(1)} s`]] : this.doing(robot, cycle, state)),
        ["Place", `${x.toFixed(3)} m, ${y.toFixed(3)} m`],
        ["Heading", `${degrees.toFixed(0)}°`],
      ];
      const led = replay.output("led_colour", robot, cycle);
      if (led !== null) facts.push(["LEDs", this.swatch(replay.ledColours[led])]);
      const signal = replay.output("signal", robot, cycle);
      if (signal !== null) facts.push(["Signal", String(signal)]);
      const count = replay.reading("neighbours", robot, cycle);
      if (count !== null) facts.push(["Neighbours", String(count)]);
      const ground = replay.reading("ground", robot, cycle);
      if (ground !== null) facts.push(["Ground", this.swatch(replay.grounds[ground])]);
      if (replay.proximity) {
        const values = [...(replay.readings("proximity", robot, cycle, replay.proximity.angles.length) || [])];
        const nearest = Math.min(NOTHING, ...values);
        if (values.length) facts.push(["Nearest", nearest === NOTHING ? "nothing in sight" : `${((nearest / replay.proximity.steps) * replay.proximity.range).toFixed(2)} m`]);
      }
      this.facts.replaceChildren(...facts.flatMap(([name, value]) => [make("dt", { text: name }), make("dd", {}, value)]));
      this.light(robot, cycle, state);
    }

    /** What is said of the active part of a robot, or of its wheels if it has a network. */
    doing(robot, cycle, state) {
      const { replay } = this;
      const machine = replay.machine(robot);
      if (machine && machine.architecture === "network") {
        const levels = replay.activity(robot, cycle);
        const outputs = [...this.diagram.querySelectorAll("[data-output]")];
        const wheels = levels && outputs.map(({ dataset }) => `${dataset.output} ${(levels[dataset.node] / 50 - 1).toFixed(2)}`);
        return wheels && wheels.length ? [["Wheels", wheels.join(", ")]] : [];
      }
      const age = `for ${(replay.age(robot, cycle) * replay.period).toFixed(1)} s`;
      return [[machine && machine.architecture === "tree" ? "Action" : "State", `${machine ? machine.states[state] : state}, ${age}`]];
    }

    /** Scroll the panel to the active box when another one becomes active, and tell whether there is more below. */
    reveal(box) {
      const { panel } = this;
      if (box && box !== this.revealed) {
        const [top, bottom] = [this.facts.getBoundingClientRect().bottom, panel.getBoundingClientRect().bottom - MORE];
        const place = box.getBoundingClientRect();
        if (place.bottom > bottom) panel.scrollTop += place.bottom - bottom + 8;
        else if (place.top < top) panel.scrollTop -= top - place.top + 8;
      }
      this.revealed = box;
      this.more.hidden = panel.scrollHeight - panel.scrollTop - panel.clientHeight < 4;
    }

    swatch({ name, colour }) {
      return make("span", {}, make("i", { style: `background:${colour}` }), name);
    }

    /** The transition that a robot took within the last half second, as "from-number"; null if none. */
    firedAt(robot, cycle) {
      const fired = this.replay.arrays.fired;
      const end = Math.min(Math.ceil(cycle), this.replay.cycles);
      for (let c = end; fired && c > Math.max(0, end - Math.ceil(0.5 / this.replay.period)); c--) {
        const number = fired[robot * this.replay.cycles + c - 1];
        if (number) return `${this.replay.state(robot, c - 1)}-${number - 1}`;
      }
      return null;
    }

    /** Show in the diagram what a robot does: of a tree the branch down to the node that acts, and what was ticked. */
    light(robot, cycle, state) {
      const machine = this.replay.machine(robot);
      const levels = this.replay.activity(robot, cycle);
      if (machine && machine.architecture === "network") {
        this.reveal(null);
        for (const node of this.diagram.querySelectorAll("[data-node]")) {
          const level = levels ? levels[node.dataset.node] / 100 : 0;
          node.style.fill = `color-mix(in srgb, currentColor ${100 * level}%, var(--panel))`;
          node.querySelector("title").textContent = `${node.dataset.name}${levels ? `: ${level.toFixed(2)}` : ""}`;
        }
        return;
      }
      const isTree = machine && machine.architecture === "tree";
      const branch = new Set(isTree && state > 0 ? [0] : []);
      for (let k = state; isTree && k > 0; k = machine.parents[k]) branch.add(k);
      const fired = this.firedAt(robot, cycle);
      for (const node of this.diagram.querySelectorAll("[data-state]")) {
        const k = Number(node.dataset.state);
        node.classList.toggle("active", k === state && (!isTree || k > 0));
        node.classList.toggle("branch", branch.has(k));
        node.classList.toggle("idle", Boolean(isTree && levels && !levels[k]));
        const mark = node.querySelector(".mark");
        if (mark) mark.textContent = levels ? MARKS[levels[k]] : "";
      }
      this.reveal(this.diagram.querySelector(".active .box"));
      for (const edge of this.diagram.querySelectorAll("[data-transition]")) edge.classList.toggle("active", edge.dataset.transition === fired);
    }
  }

  /** The clock of all scenes on a page, and its controls. */
  class Player {
    constructor(root, replays, keyboard) {
      this.root = root;
      this.replays = replays;
      this.cycle = 0;
      this.speed = 1;
      this.isPlaying = false;
      this.options = {
        trails: true, presence: false, proximity: false, neighbours: false, lidar: false, zones: true, map: true, follow: false,
        robot: null,
      };
      this.cycles = Math.max(...replays.map((replay) => replay.cycles));
      this.scenes = replays.map((replay) => new Scene(replay, this.options, this));
      root.classList.add("mr");
      root.classList.toggle("mr-several", replays.length > 1);
      root.replaceChildren(make("div", { class: "mr-scenes" }, ...this.scenes.map((scene) => scene.element)), this.controls());
      keyboard.addEventListener("keydown", (event) => this.key(event));
      new ResizeObserver(() => this.redraw()).observe(root);
      this.followScheme();
      this.redraw();
    }

    /** Redraw when the page becomes dark or light. The media query outlives the player, and so must not keep it. */
    followScheme() {
      const dark = matchMedia("(prefers-color-scheme: dark)");
      const weak = new WeakRef(this);
      const redraw = () => {
        const player = weak.deref();
        if (player) player.redraw();
        else dark.removeEventListener("change", redraw);
      };
      dark.addEventListener("change", redraw);
    }

    controls() {
      const button = (label, hint, action) => make("button", { type: "button", title: hint, "aria-label": hint, text: label, on: { click: action } });
      this.playButton = button("Play", "Play or pause (space)", () => this.toggle());
      this.slider = make("input", {
        type: "range", min: "0", max: String(this.cycles), step: "1", value: "0", "aria-label": "Time",
        on: { input: () => this.seek(Number(this.slider.value)) },
      });
      this.speeds = make(
        "select",
        { "aria-label": "Speed", on: { change: () => (this.speed = Number(this.speeds.value)) } },
        ...SPEEDS.map((speed) => make("option", { value: String(speed), text: `${speed}×`, selected: speed === 1 }))
      );
      const has = (name) => this.replays.some((replay) => replay.arrays[name]);
      const shown = [
        ["trails", "Trails", "t", true],
        ["presence", "Presence", "p", true],
        ["zones", "Zones", "z", true],
        ["map", "Map", "m", this.replays.some((replay) => replay.map)],
        ["proximity", "Proximity", "x", has("proximity")],
        ["neighbours", "Neighbours", "n", has("seen")],
        ["lidar", "Lidar", "l", this.replays.some((replay) => replay.lidar)],
        ["follow", "Follow", "f", true],
      ].filter(([, , , isThere]) => isThere);
      this.toggles = Object.fromEntries(
        shown.map(([name, label, key]) => [
          name,
          make("button", {
            type: "button", text: label, title: `${label} (${key})`, "aria-pressed": String(this.options[name]),
            on: { click: () => this.switch(name) },
          }),
        ])
      );
      this.keys = Object.fromEntries(shown.map(([name, , key]) => [key, name]));
      return make(
        "nav",
        { class: "mr-controls", "aria-label": "Playback" },
        make("div", { class: "mr-transport" },
          this.playButton,
          button("◂", "One cycle back (left)", () => this.step(-1)),
          button("▸", "One cycle on (right)", () => this.step(1)),
          this.slider,
          this.speeds),
        make("div", { class: "mr-toggles" }, ...Object.values(this.toggles), button("Reset view", "Reset view (0)", () => this.resetView()))
      );
    }

    key(event) {
      const isPressed = event.target instanceof HTMLButtonElement && [" ", "Enter"].includes(event.key);
      if (isPressed || event.target instanceof HTMLSelectElement || event.ctrlKey || event.metaKey || event.altKey) return;
      const actions = {
        " ": () => this.toggle(),
        ArrowLeft: () => this.step(event.shiftKey ? -10 : -1),
        ArrowRight: () => this.step(event.shiftKey ? 10 : 1),
        ArrowUp: () => this.changeSpeed(1),
        ArrowDown: () => this.changeSpeed(-1),
        Home: () => this.seek(0),
        End: () => this.seek(this.cycles),
        "+": () => this.zoom(1.25),
        "-": () => this.zoom(0.8),
        0: () => this.resetView(),
        "[": () => this.next(-1),
        "]": () => this.next(1),
        Escape: this.options.robot !== null && (() => this.choose(null)), // else for the dialog around the viewer
      };
      const action = actions[event.key] || (this.keys[event.key] && (() => this.switch(this.keys[event.key])));
      if (!action) return;
      event.preventDefault();
      action();
    }

    toggle() {
      if (this.cycle >= this.cycles) this.cycle = 0;
      this.isPlaying = !this.isPlaying;
      this.last = null;
      this.redraw();
    }

    pause() {
      if (this.isPlaying) this.toggle();
    }

    step(cycles) {
      this.isPlaying = false;
      this.seek(Math.round(this.cycle) + cycles);
    }

    seek(cycle) {
      this.cycle = Math.min(Math.max(cycle, 0), this.cycles);
      this.redraw();
    }

    changeSpeed(by) {
      const at = SPEEDS.indexOf(this.speed) + by;
      this.speed = SPEEDS[Math.min(Math.max(at, 0), SPEEDS.length - 1)];
      this.speeds.value = String(this.speed);
    }

    switch(name) {
      this.options[name] = !this.options[name];
      if (name === "follow" && this.options.follow) {
        if (this.options.robot === null) this.options.robot = 0;
        for (const { stage } of this.scenes) if (stage.zoom === 1) stage.zoom = FOLLOWING;
      } else if (name === "follow") {
        for (const { stage } of this.scenes) if (stage.zoom === FOLLOWING) stage.zoom = 1;
      }
      if (name === "lidar" && this.options.lidar && this.options.robot === null) this.options.robot = 0;
      this.toggles[name].setAttribute("aria-pressed", String(this.options[name]));
      this.redraw();
    }

    choose(robot) {
      this.options.robot = robot;
      if (robot === null && this.options.follow) this.switch("follow");
      this.redraw();
    }

    next(by) {
      const robots = Math.max(...this.replays.map((replay) => replay.robots));
      const before = this.options.robot === null ? (by > 0 ? -1 : 0) : this.options.robot;
      this.choose((before + by + robots) % robots);
    }

    zoom(ratio) {
      for (const scene of this.scenes) scene.zoomAt(ratio, 0.5 * scene.stage.canvas.clientWidth, 0.5 * scene.stage.canvas.clientHeight);
    }

    resetView() {
      for (const { stage } of this.scenes) [stage.zoom, stage.pan] = [1, [0, 0]];
      this.redraw();
    }

    redraw() {
      if (this.frame) return;
      this.frame = requestAnimationFrame((now) => {
        this.frame = null;
        if (this.isPlaying) {
          if (this.last !== null) this.cycle += ((now - this.last) / 1000) * (this.speed / this.replays[0].period);
          this.last = now;
          if (this.cycle >= this.cycles) [this.cycle, this.isPlaying] = [this.cycles, false];
        }
        this.draw();
        if (this.isPlaying) this.redraw();
      });
    }

    draw() {
      for (const scene of this.scenes) scene.draw(this.cycle);
      this.slider.value = String(Math.round(this.cycle));
      this.playButton.textContent = this.isPlaying ? "Pause" : "Play";
    }
  }

  /** Show replays in an element; `isWholePage`: keys count wherever they are pressed, not only within the element. */
  async function mount(element, sources, isWholePage = false) {
    const replays = await Promise.all(sources.map((source) => Replay.load(source)));
    return new Player(element, replays, isWholePage ? document : element);
  }

  return { mount, Replay };
})();
