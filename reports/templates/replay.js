// Replay of one run on a canvas. No library, no request: the data is in the page.
"use strict";
(() => {
  const NOWHERE = -32768;
  const NEAR = 40; // px a metre; nearer, all furniture is named
  const LARGE = 20; // m; a floor larger than this opens as a close-up
  const reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;

  async function unpack(base64) {
    const bytes = await Page.inflate(base64);
    const end = bytes.indexOf(10);
    const data = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
    let at = end + 1;
    const kinds = { i2: Int16Array, i1: Int8Array, u1: Uint8Array, i4: Int32Array };
    for (const [name, kind, shape] of data.arrays) {
      const Kind = kinds[kind];
      const count = shape.reduce((a, b) => a * b, 1);
      const part = bytes.slice(at, at + count * Kind.BYTES_PER_ELEMENT);
      at += part.length;
      data[name] = { shape, values: new Kind(part.buffer) };
    }
    for (const name of ["xy", "people", "goal", "pieces"]) addUp(data[name]);
    return data;
  }

  function addUp({ shape, values }) { // steps to positions, wrapping at 16 bits like the writer
    const row = shape.slice(1).reduce((a, b) => a * b, 1);
    for (let i = row; i < values.length; i++) values[i] = values[i] + values[i - row];
  }

  class Replay {
    constructor(root, data) {
      this.root = root;
      this.data = data;
      this.time = 0;
      this.playing = false;
      this.speed = 4;
      this.end = data.time[data.time.length - 1];
      this.canvas = root.querySelector("canvas");
      this.clock = root.querySelector(".clock");
      this.slider = root.querySelector("input[type=range]");
      this.status = root.querySelector(".now");
      this.slider.max = this.end;
      this.slider.step = 0.1;
      this.view = this.whole();
      this.costmap = document.getElementById(root.dataset.costmap);
      this.connect();
      this.follow();
      const whole = this.view, begin = Number(root.dataset.begin || 0);
      if ("close" in root.dataset && Math.max(whole.x1 - whole.x0, whole.y1 - whole.y0) > LARGE) this.zoom();
      this.seek(begin);
      new ResizeObserver(() => this.draw()).observe(this.canvas);
      document.addEventListener("theme", () => this.draw());
    }

    connect() {
      const on = (selector, event, act) => this.root.querySelector(selector).addEventListener(event, act);
      on(".play", "click", () => this.toggle());
      on(".speed", "change", (e) => { this.speed = Number(e.target.value); });
      on(".zoom", "click", () => this.zoom());
      this.slider.addEventListener("input", () => { this.pause(); this.seek(Number(this.slider.value)); });
      for (const box of this.root.querySelectorAll(".layers input")) box.addEventListener("change", () => this.draw());
      for (const jump of this.root.querySelectorAll("[data-jump]"))
        jump.addEventListener("click", () => { this.pause(); this.seek(Number(jump.dataset.jump)); });
      this.root.addEventListener("keydown", (e) => {
        if (e.target.matches("select")) return;
        const step = e.shiftKey ? 10 : 1;
        const acts = {
          " ": () => this.toggle(), k: () => this.toggle(), z: () => this.zoom(),
          ArrowRight: () => this.seek(this.time + step), ArrowLeft: () => this.seek(this.time - step),
          Home: () => this.seek(0), End: () => this.seek(this.end),
        };
        const act = acts[e.key];
        if (!act || (e.key === " " && e.target.matches("button, input[type=checkbox]"))) return;
        e.preventDefault();
        if (e.key.startsWith("Arrow")) this.pause();
        act();
      });
    }

    follow() { // a line in the timelines at the time that is shown; a click there is a jump
      const svg = this.root.closest(".side, details.smallest, article, main").querySelector(".timelines svg");
      if (!svg) return;
      const { left, width, end } = Object.fromEntries(Object.entries(svg.dataset).map(([k, v]) => [k, Number(v)]));
      const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
      line.setAttribute("class", "cursor");
      line.setAttribute("y1", 0);
      line.setAttribute("y2", svg.viewBox.baseVal.height - 20);
      svg.append(line);
      this.mark = (time) => { for (const x of ["x1", "x2"]) line.setAttribute(x, left + (width * time) / end); };
      svg.addEventListener("click", (e) => {
        const box = svg.getBoundingClientRect();
        const x = ((e.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
        this.pause();
        this.seek(((x - left) / width) * end);
      });
    }

    shows(layer) { return this.root.querySelector(`.layers input[value=${layer}]`).checked; }

    toggle() { if (this.playing) this.pause(); else this.play(); }

    play() {
      if (this.time >= this.end) this.seek(0);
      this.playing = true;
      this.button();
      let last = performance.now();
      const frame = (now) => {
        if (!this.playing) return;
        this.seek(this.time + ((now - last) / 1000) * this.speed);
        last = now;
        if (this.time >= this.end) this.pause(); else requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
    }

    pause() { this.playing = false; this.button(); }

    button() {
      const button = this.root.querySelector(".play");
      button.textContent = this.playing ? "Pause" : "Play";
      button.setAttribute("aria-pressed", this.playing);
    }

    seek(time, alone = false) {
      if (!alone) for (const beside of this.root.closest(".sides")?.querySelectorAll(".replay") ?? [])
        if (beside !== this.root) beside.replay?.seek(time, true);
      this.time = Math.min(Math.max(time, 0), this.end);
      this.slider.value = this.time;
      const text = `${this.time.toFixed(1)} s`;
      this.clock.textContent = `${text} of ${this.end.toFixed(1)} s`;
      this.slider.setAttribute("aria-valuetext", text);
      if (this.mark) this.mark(this.time);
      this.draw();
    }

    frame() { // index of the last kept frame at or before now
      const t = this.data.time;
      let low = 0, high = t.length - 1;
      while (low < high) { const mid = (low + high + 1) >> 1; if (t[mid] <= this.time) low = mid; else high = mid - 1; }
      return low;
    }

    point(array, frame, i) { // metres, between two frames
      const { shape, values } = array;
      const at = (f) => (f * shape[1] + i) * 2;
      const a = at(frame);
      if (values[a] === NOWHERE) return null;
      const next = Math.min(frame + 1, shape[0] - 1), b = at(next), t = this.data.time;
      const span = t[next] - t[frame];
      const share = span > 0 && values[b] !== NOWHERE ? Math.min(1, (this.time - t[frame]) / span) : 0;
      return [0, 1].map((k) => (values[a + k] + share * (values[b + k] - values[a + k])) / 100);
    }

    whole() {
      const [x0, y0, x1, y1] = this.data.world.extent;
      return { x0, y0, x1, y1 };
    }

    zoom() {
      this.close = !this.close;
      const place = (this.root.dataset.place || "").split(",").map(Number);
      const [x, y] = place.length === 2 && place.every(Number.isFinite) ? place
        : this.point(this.data.xy, this.frame(), 0);
      const [across, up] = this.canvas.getBoundingClientRect().width > 600 ? [8, 5] : [5, 5];
      this.view = this.close ? { x0: x - across, y0: y - up, x1: x + across, y1: y + up } : this.whole();
      this.root.querySelector(".zoom").textContent = this.close ? "Whole floor" : "Close up";
      this.draw();
    }

    draw() { // from the floor up
      const pen = this.pen();
      if (!pen) return;
      const f = this.frame(), places = this.data.world.robots.map((_, i) => this.point(this.data.xy, f, i));
      if (this.shows("costmap")) this.paintCostmap(pen);
      for (const row of this.data.world.scene) this.paintShape(pen, row);
      this.paintPieces(pen, f);
      for (const row of this.data.world.scene) if (row[0] === "room") this.paintRoom(pen, row);
      if (this.shows("names")) this.nameThings(pen, f);
      if (this.shows("clusters")) this.paintClusters(pen, f, places);
      if (this.shows("paths")) this.paintPaths(pen);
      if (this.shows("rays")) this.paintRays(pen);
      this.paintPeople(pen, f);
      const said = this.paintRobots(pen, f, places);
      if (this.shows("waits")) this.paintWaits(pen, f, places, said);
      this.status.textContent = said.join(" \u00b7 ");
    }

    pen() { // the canvas, cleared, and how to get there from the map frame
      const canvas = this.canvas, box = canvas.getBoundingClientRect();
      if (!box.width) return null;
      const view = this.view, ratio = devicePixelRatio || 1;
      const height = Math.min(box.width * (view.y1 - view.y0) / (view.x1 - view.x0), innerHeight * 0.8);
      canvas.style.height = `${height}px`;
      canvas.width = Math.round(box.width * ratio);
      canvas.height = Math.round(height * ratio);
      const scale = Math.min(canvas.width / (view.x1 - view.x0), canvas.height / (view.y1 - view.y0));
      const left = (canvas.width - scale * (view.x1 - view.x0)) / 2;
      const css = getComputedStyle(this.root), g = canvas.getContext("2d");
      g.clearRect(0, 0, canvas.width, canvas.height);
      g.lineJoin = "round";
      const px = (x, y) => [left + (x - view.x0) * scale, canvas.height - (y - view.y0) * scale];
      const colour = (name) => css.getPropertyValue(`--${name}`).trim();
      const line = (points, closed) => { // centimetres, flat
        g.beginPath();
        for (let i = 0; i < points.length; i += 2) g.lineTo(...px(points[i] / 100, points[i + 1] / 100));
        if (closed) g.closePath();
      };
      const disc = (x, y, radius) => { g.beginPath(); g.arc(x, y, radius, 0, 7); };
      const stroke = (shade, width) => { g.strokeStyle = shade; g.lineWidth = width * ratio; g.stroke(); };
      const fill = (shade) => { g.fillStyle = shade; g.fill(); };
      const text = (string, x, y, size, shade) => {
        g.font = `${size * ratio}px system-ui, sans-serif`;
        g.textAlign = "center";
        g.lineWidth = 3 * ratio;
        g.strokeStyle = colour("paper");
        g.strokeText(string, x, y);
        g.fillStyle = shade;
        g.fillText(string, x, y);
      };
      return { g, px, scale, ratio, colour, line, disc, stroke, fill, text };
    }

    paintCostmap({ g, px }) {
      if (!this.costmap || !this.costmap.naturalWidth) return;
      const [x0, y0, x1, y1] = this.root.dataset.extent.split(",").map(Number);
      const a = px(x0, y1), b = px(x1, y0);
      g.imageSmoothingEnabled = false;
      g.drawImage(this.costmap, a[0], a[1], b[0] - a[0], b[1] - a[1]);
    }

    paintShape(pen, [role, points, name, start, end]) { // what stands still; colours by role
      const { px, scale, colour, line, disc, stroke, fill } = pen;
      if (role === "lane") {
        if (this.shows("lanes")) { line(points); stroke(colour("lane-edge"), 1); }
      } else if (role === "furniture" || role === "wall") {
        line(points, true); fill(colour(role));
      } else if (role === "blockage") {
        if (this.time < start || this.time >= end) return;
        line(points, true); fill(colour(role)); stroke(colour("blockage-edge"), 1);
        pen.text(name, ...px(points[0] / 100, points[1] / 100), 10, colour("bad"));
      } else if (role === "door") {
        line(points); stroke(colour(role), 2);
      } else if (role === "queue-spot" || role === "parking") {
        if (!this.shows("queues")) return;
        disc(...px(points[0] / 100, points[1] / 100), 0.15 * scale);
        fill(colour(role)); stroke(colour(`${role}-edge`), 1);
      }
    }

    paintRoom({ px, text, colour }, [, [x, y], name]) { text(name, ...px(x / 100, y / 100), 10, colour("soft")); }

    paintPieces({ line, fill, colour }, f) { // furniture that was pushed
      const { pieces } = this.data.world;
      pieces.forEach(([, , outline], i) => {
        const place = this.point(this.data.pieces, f, i);
        if (!place) return;
        const turn = (this.data.pieces_turn.values[f * pieces.length + i] / 256) * 2 * Math.PI;
        const c = Math.cos(turn), s = Math.sin(turn), moved = [];
        for (let k = 0; k < outline.length; k += 2) moved.push(
          100 * place[0] + c * outline[k] - s * outline[k + 1], 100 * place[1] + s * outline[k] + c * outline[k + 1]);
        line(moved, true); fill(colour("furniture"));
      });
    }

    nameThings({ px, scale, ratio, colour, text }, f) { // what took part from afar, all from near
      const { things, pieces } = this.data.world, near = scale / ratio > NEAR;
      const write = (name, x, y) => {
        const concerned = this.data.concerned.includes(name);
        if (concerned || near) text(name, ...px(x, y), concerned ? 11 : 9, colour(concerned ? "bad" : "soft"));
      };
      for (const [name, x, y] of things) write(name, x / 100, y / 100);
      pieces.forEach(([name], i) => {
        const place = this.point(this.data.pieces, f, i);
        if (place) write(name, ...place);
      });
    }

    clusterOf(f, robot) { return this.data.cluster.values[f * this.data.world.robots.length + robot]; }

    paintClusters({ g, px, colour, stroke }, f, places) { // a line between robots of one cluster
      g.globalAlpha = 0.35;
      for (let i = 0; i < places.length; i++) for (let j = i + 1; j < places.length; j++) {
        if (this.clusterOf(f, i) !== this.clusterOf(f, j)) continue;
        g.beginPath(); g.moveTo(...px(...places[i])); g.lineTo(...px(...places[j])); stroke(colour("planning"), 6);
      }
      g.globalAlpha = 1;
    }

    paintPaths({ g, ratio, line, stroke }) {
      const { robots } = this.data.world, latest = new Array(robots.length).fill(null);
      for (const [time, robot, points] of this.data.paths) { if (time > this.time) break; latest[robot] = points; }
      g.setLineDash([5 * ratio, 4 * ratio]);
      latest.forEach((points, i) => { if (points && points.length >= 4) { line(points); stroke(robots[i][1], 1.5); } });
      g.setLineDash([]);
    }

    paintRays({ g, px, ratio, colour }) {
      const times = this.data.rays_time.values, { shape, values } = this.data.rays;
      let k = -1;
      while (k + 1 < times.length && times[k + 1] / 10 <= this.time) k++;
      if (k < 0) return;
      g.fillStyle = colour("bad");
      const row = shape[1] * shape[2] * 2;
      for (let i = k * row; i < (k + 1) * row; i += 2) if (values[i] !== NOWHERE) {
        const [x, y] = px(values[i] / 100, values[i + 1] / 100);
        g.fillRect(x - 1.5 * ratio, y - 1.5 * ratio, 3 * ratio, 3 * ratio);
      }
    }

    paintPeople({ px, scale, ratio, colour, disc, fill, text }, f) {
      this.data.world.people.forEach(([name, radius, role], i) => {
        const place = this.point(this.data.people, f, i);
        if (!place) return;
        const [x, y] = px(...place);
        disc(x, y, radius * scale); fill(colour(role));
        if (this.shows("names")) text(name, x, y - radius * scale - 3 * ratio, 9, colour("soft"));
      });
    }

    paintRobots({ g, px, scale, ratio, colour, disc, stroke, fill, text }, f, places) { // returns what each is doing
      const { robots } = this.data.world, n = robots.length;
      const clusters = robots.map((_, i) => this.clusterOf(f, i));
      return robots.map(([name, shade, radius], i) => {
        const [x, y] = px(...places[i]), size = Math.max(radius * scale, 4 * ratio);
        const yaw = (this.data.yaw.values[f * n + i] / 256) * 2 * Math.PI;
        disc(x, y, size); fill(shade);
        g.beginPath(); g.moveTo(x, y); g.lineTo(x + size * Math.cos(yaw), y - size * Math.sin(yaw)); stroke("#fff", 2);
        const leads = this.data.leader.values[f * n + i] === i && clusters.filter((c) => c === clusters[i]).length > 1;
        if (this.shows("clusters") && leads) { disc(x, y, size + 3 * ratio); stroke(colour("planning"), 2); }
        if (this.shows("names")) text(name, x, y + size + 11 * ratio, 10, colour("ink"));
        return `${name}: ${this.data.phases[this.data.phase.values[f * n + i]]}`;
      });
    }

    paintWaits({ g, px, scale, ratio, colour, disc, stroke }, f, places, said) { // who blocks whom, also in words
      const { people, robots } = this.data.world, now = this.time;
      for (const [start, end, robot, cause, other, resource] of this.data.edges) {
        if (now < start || now >= end) continue;
        const from = px(...places[robot]), human = cause === "human";
        const place = other < 0 ? null : human ? this.point(this.data.people, f, other) : places[other];
        const who = other < 0 ? resource : (human ? people : robots)[other][0];
        said[robot] += `, ${cause}${who ? " " + who : ""}`;
        if (place) this.arrow(g, from, px(...place), colour("bad"), ratio);
        else { disc(...from, 0.35 * scale); stroke(colour("bad"), 2); }
      }
    }

    arrow(g, from, to, colour, ratio) {
      const [dx, dy] = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(dx, dy);
      if (length < 1) return;
      const [ux, uy] = [dx / length, dy / length], head = 9 * ratio;
      g.strokeStyle = g.fillStyle = colour; g.lineWidth = 2.5 * ratio;
      g.beginPath(); g.moveTo(...from); g.lineTo(to[0] - ux * head, to[1] - uy * head); g.stroke();
      g.beginPath(); g.moveTo(...to);
      g.lineTo(to[0] - ux * head - uy * head / 2, to[1] - uy * head + ux * head / 2);
      g.lineTo(to[0] - ux * head + uy * head / 2, to[1] - uy * head - ux * head / 2);
      g.fill();
    }
  }

  async function start(root) {
    if (root.dataset.state) return;
    root.dataset.state = "loading";
    try {
      const data = await unpack(root.querySelector("script").textContent);
      root.replay = new Replay(root, data);
      root.dataset.state = "ready";
      root.querySelector(".controls").hidden = false;
      if (root.dataset.autoplay === "yes" && !reduced) root.replay.play();
    } catch (error) {
      root.dataset.state = "failed";
      root.querySelector(".now").textContent = `The replay cannot be shown here: ${error.message}. The pictures below do not need it.`;
    }
  }

  const watch = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) { watch.unobserve(entry.target); start(entry.target); }
  }, { rootMargin: "200px" });
  for (const root of document.querySelectorAll(".replay")) watch.observe(root);
})();
