/* Arms that are simulated in the page, by the compiled kernels of the package.

   A *run* is the memory that Python's `simulate` has before its first step. The equations, the
   steps and the poses are those of the kernels; this file sets the numbers of the sliders, calls
   the kernels and draws. `docs/site/live` writes the memory and the kernels. */
"use strict";
(() => {
  const flexarm = globalThis.flexarm ??= {};
  const TYPES = {f8: Float64Array, i8: BigInt64Array, i4: Int32Array, i2: Int16Array, i1: Int8Array};
  // Places of `flexarm.integrate.memory` and `sampled_law`; codes of `flexarm.integrate.status`.
  const TIME = 0, STEP = 1, SAMPLES = 0, TICK = 0, LAST = 1, END = 3, BENT = 2, REFUSED = 3;
  const DONE = 0, PAUSED = 1, INERTIA_LOST = 4;
  /* Steps of one call: the motion is computed this far ahead of the picture, at most. */
  const STEPS = 4;
  /* Longest time (ms) to compute for one picture: a slow device plays slower instead. */
  const BUDGET = 30;

  const bytesOf = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const failure = status => status === INERTIA_LOST
    ? "The mass matrix is no longer positive." : "The motion grows without bound.";

  async function inflated(text) {
    const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  // One simulated arm -------------------------------------------------------------------------

  class Run {
    static async load(module, label, image) {
      const {exp, log, pow} = Math, run = new Run();
      run.kernels = (await WebAssembly.instantiate(module, {env: {exp, log, pow}})).exports;
      Object.assign(run, {label, image, initial: await inflated(image.data), error: ""});
      const {memory, __heap_base} = run.kernels;
      run.base = Math.ceil(__heap_base.value / 16) * 16;
      const missing = run.base + image.size - memory.buffer.byteLength;
      if (missing > 0) memory.grow(Math.ceil(missing / 65536));
      run.view = new DataView(memory.buffer);
      run.arrays = {};
      for (const [name, [place, type, shape]] of Object.entries(image.arrays)) {
        const count = shape.reduce((product, length) => product * length, 1);
        run.arrays[name] = new TYPES[type](memory.buffer, run.base + place, count);
      }
      run.sampled = "sampled" in image.tables;
      run.reset();
      return run;
    }

    /* Return to the start; the numbers of the sliders must be set again. */
    reset() {
      new Uint8Array(this.kernels.memory.buffer).set(this.initial, this.base);
      for (const place of this.image.addresses) {
        const word = this.base + place;
        this.view.setUint32(word, this.view.getUint32(word, true) + this.base, true);
      }
      if (!this.sampled) {
        const place = this.base + this.image.numbers.most_steps;
        this.view.setBigInt64(place, BigInt(STEPS), true);
      }
      this.error = "";
    }

    /* Set some numbers of an array, or an argument that is a number. */
    set(name, indices, numbers) {
      const array = this.arrays[name];
      if (!array) this.view.setFloat64(this.base + this.image.numbers[name], numbers[0], true);
      else if (array instanceof BigInt64Array) indices.forEach((k, j) => array[k] = BigInt(numbers[j]));
      else indices.forEach((k, j) => array[k] = numbers[j]);
    }

    /* Continue after a change of the arm, as Python does: without memory of earlier steps. */
    forget() {
      const clock = this.arrays["memory.clock"], [time, step] = clock;
      clock.fill(0);
      clock[TIME] = time;
      clock[STEP] = step;
    }

    get samples() { return Number(this.arrays["memory.counts"][SAMPLES]); }

    call(kernel) { return this.kernels[kernel](this.base + this.image.tables[kernel]); }

    /* Advance until a sample is computed, number 0 at the start; set `error` where that fails. */
    advance(sample) {
      while (!this.error && this.samples <= sample) {
        if (this.sampled) this.tick(sample);
        else {
          const status = this.call("advance");
          if (status !== DONE && status !== PAUSED) this.error = failure(status);
        }
      }
    }

    /* Advance to the tick of the controller after a sample, or by one tick. */
    tick(sample) {
      const counts = this.arrays["law.counts"], [period, end] = this.arrays["law.times"];
      const ticks = Math.ceil(end / period * (1 - 1e-12));
      const wanted = Math.ceil(this.arrays["memory.sample_times"][sample] / period * (1 - 1e-12));
      const last = Math.min(ticks, Math.max(wanted, Number(counts[TICK]) + 1));
      counts[LAST] = BigInt(last);
      counts[END] = BigInt(REFUSED);
      const status = this.call("sampled");
      if (status !== DONE) this.error = failure(status);
      else if (Number(counts[END]) === BENT) this.error = "A link has bent far beyond its length.";
      else if (Number(counts[TICK]) < last) this.error = "The torques are not finite.";
    }

    /* The state at a sample: coordinates, then rates; see `flexarm.kernels.layout`. */
    state(sample) {
      const size = this.arrays["memory.state"].length;
      return this.arrays["memory.samples"].subarray(sample * size, (sample + 1) * size);
    }

    /* Compute the poses (bodies, 16) of a sample, with its bending times a factor. */
    poses(sample, factor, turns) {
      const drawn = this.arrays.drawn, width = this.image.arrays.drawn[2][2];
      drawn.set(this.state(sample));
      if (factor !== 1) drawn.forEach((value, k) => { if (k % width) drawn[k] = value * factor; });
      if (!turns) drawn[0] = 0;
      this.call("poses");
      return this.arrays.poses;
    }

    /* Compute the points of the axes of the links (points, 2) after `poses`, m. */
    points() {
      this.call("axis");
      return this.arrays.points;
    }
  }

  // The page of a scene ------------------------------------------------------------------------

  const element = (parent, tag, properties = {}, text = "") => {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(properties)) made.setAttribute(name, value);
    made.textContent = text;
    parent.append(made);
    return made;
  };

  class Player {
    /* Load the runs of a scene; `box` is the element to fill, or null for programs. */
    static async load(box, scene, module) {
      const player = new Player();
      Object.assign(player, {box, scene, sample: 0, clock: 0, playing: false, pictures: 0});
      player.last = Math.round(scene.duration * scene.rate);
      player.runs = [];
      for (const {label, image} of scene.runs) player.runs.push(await Run.load(module, label, image));
      for (const slider of scene.sliders) {
        slider.place = player.placeOf(slider, slider.start);
        for (const effect of slider.effects) {
          effect.run = player.runs.find(run => run.label === effect.run);
          effect.indices = new Int32Array(bytesOf(effect.indices).buffer);
          effect.values = new Float64Array(bytesOf(effect.values).buffer);
        }
      }
      if (box) player.build();
      player.restart();
      return player;
    }

    placeOf(slider, value) {
      const away = slider.values.map(other => Math.abs(other - value));
      return away.indexOf(Math.min(...away));
    }

    /* Apply the effects of a slider; in a run that moves, its state and counts are its own. */
    apply(slider, moving) {
      for (const {run, name, indices, values} of slider.effects) {
        if (moving && name.startsWith("memory.")) continue;
        const start = slider.place * indices.length;
        run.set(name, indices, values.subarray(start, start + indices.length));
      }
    }

    restart() {
      for (const run of this.runs) {
        run.reset();
        run.traces = this.scene.traces.map(() => []);
        run.frozen = -1;
      }
      for (const slider of this.scene.sliders) this.apply(slider, false);
      this.sample = this.clock = 0;
      this.compute(0);
      this.say("");
      this.draw();
    }

    /* Set a slider by its name to the nearest of its values. */
    set(name, value) {
      const slider = this.scene.sliders.find(other => other.name === name);
      const before = slider.values[slider.place];
      slider.place = this.placeOf(slider, value);
      const after = slider.values[slider.place];
      this.show(slider);
      if (after === before) return;
      const live = slider.live === "yes" || (slider.live === "down" && after < before);
      if (!live || this.sample === 0) return this.restart();
      this.apply(slider, true);
      for (const run of this.runs) if (slider.effects.some(effect => effect.run === run)) run.forget();
    }

    /* Compute all runs up to a sample, and their traces. */
    compute(sample) {
      for (const run of this.runs) {
        for (let k = run.traces[0].length; k <= sample && run.frozen < 0; k++) {
          run.advance(k);
          const poses = run.error ? null : run.poses(k, 1, true);
          this.scene.traces.forEach(({body, column, scale, limit}, number) => {
            if (run.error) return;
            const value = poses[16 * body + column];
            if (!(Math.abs(value) <= limit)) run.error = "A link bends beyond the theory.";
            run.traces[number].push(scale * value);
          });
          if (run.error) {
            run.frozen = Math.max(0, k - 1);
            const which = this.runs.length > 1 ? `${run.label}: ` : "";
            this.say(`${which}${run.error} The run stops at ${(k / this.scene.rate).toFixed(2)} s.`);
          }
        }
      }
    }

    /* Compute up to a time (s) without drawing all pictures, and show the picture at it. */
    runTo(time) {
      this.sample = Math.min(this.last, Math.round(time * this.scene.rate));
      this.clock = this.sample;
      this.compute(this.sample);
      this.draw();
    }

    /* Numbers at the time shown. */
    get state() {
      return {
        time: this.sample / this.scene.rate,
        sliders: Object.fromEntries(
          this.scene.sliders.map(({name, values, place}) => [name, values[place]])),
        runs: this.runs.map(run => ({
          label: run.label, error: run.error,
          state: Array.from(run.state(this.at(run))),
          traces: run.traces.map(trace => trace[this.at(run)]),
        })),
      };
    }

    at(run) { return run.frozen < 0 ? this.sample : Math.min(this.sample, run.frozen); }

    play(on) {
      if (on && (this.sample >= this.last || this.runs.every(run => run.error))) this.restart();
      this.playing = on;
      this.toggle.textContent = on ? "Pause" : "Play";
      this.before = null;
      if (on) requestAnimationFrame(now => this.frame(now));
    }

    frame(now) {
      if (!this.playing) return;
      const passed = this.before === null ? 0 : Math.min(0.1, (now - this.before) / 1000);
      this.before = now;
      this.clock = Math.min(this.last, this.clock + passed * this.speed * this.scene.rate);
      const wanted = Math.floor(this.clock), begun = performance.now();
      while (this.sample < wanted && performance.now() - begun < BUDGET) this.compute(++this.sample);
      if (this.sample < wanted) this.clock = this.sample;
      this.pictures += 1;
      this.draw();
      if (this.sample >= this.last || this.runs.every(run => run.error)) this.play(false);
      else requestAnimationFrame(next => this.frame(next));
    }

    say(text) {
      if (this.status && this.status.textContent !== text) this.status.textContent = text;
    }

    // Controls ---------------------------------------------------------------------------------

    build() {
      const {box, scene} = this;
      box.textContent = "";
      this.legend = element(box, "p", {class: "live-legend"});
      if (this.runs.length > 1) this.runs.forEach((run, k) => {
        element(this.legend, "span", {class: `live-color-${k + 1}`}, "\u2501 ");
        element(this.legend, "span", {}, `${run.label}   `);
      });
      const description = `Moving picture of the arm. ${scene.traces.map(trace => trace.label).join(", ")} over time below.`;
      this.canvas = element(box, "canvas", {class: "live-arm", role: "img", "aria-label": description});
      this.chart = element(box, "canvas", {class: "live-chart", "aria-hidden": "true"});
      const buttons = element(box, "div", {class: "live-buttons"});
      this.toggle = element(buttons, "button", {type: "button"}, "Play");
      this.toggle.addEventListener("click", () => this.play(!this.playing));
      const again = element(buttons, "button", {type: "button"}, "Restart");
      again.addEventListener("click", () => { this.restart(); this.play(true); });
      if (scene.button) {
        const [text, name] = scene.button, act = element(buttons, "button", {type: "button"}, text);
        act.addEventListener("click", () => {
          this.set(name, scene.sliders.find(slider => slider.name === name).values[0]);
          if (!this.playing) this.play(true);
        });
      }
      const speeds = [[1, "real time"], [0.5, "1/2 speed"], [0.25, "1/4 speed"], [0.1, "1/10 speed"]];
      this.choice(buttons, "Speed", speeds, scene.speed, value => { this.speed = value; });
      const factors = [1, 2, 5, 10, 20].map(factor => [factor, `\u00d7${factor}`]);
      this.choice(buttons, "Bending drawn", factors, scene.magnify, value => {
        this.magnify = value;
        this.draw();
      });
      const controls = element(box, "div", {class: "live-sliders"});
      for (const slider of scene.sliders) this.slider(controls, slider);
      this.status = element(box, "p", {class: "live-status", role: "status"});
      const redraw = () => this.draw();
      new ResizeObserver(redraw).observe(box);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
      new MutationObserver(redraw).observe(document.body, {attributes: true});
    }

    choice(parent, text, options, start, act) {
      const label = element(parent, "label", {}, `${text} `), select = element(label, "select");
      for (const [value, shown] of options) element(select, "option", {value}, shown);
      select.value = start;
      select.addEventListener("change", () => act(Number(select.value)));
      if (text === "Speed") this.speed = start;
      else this.magnify = start;
    }

    slider(parent, slider) {
      const label = element(parent, "label");
      element(label, "span", {}, slider.label);
      // A label belongs to the first control in it.
      slider.input = element(label, "input", {
        type: "range", min: 0, max: slider.values.length - 1, step: 1, name: slider.name,
      });
      slider.output = element(label, "output");
      slider.input.addEventListener("input", () => {
        this.set(slider.name, slider.values[slider.input.value]);
        if (!this.playing) this.play(true);
      });
      this.show(slider);
    }

    show(slider) {
      if (!slider.input) return;
      const text = `${signed(Number(slider.values[slider.place].toPrecision(6)))} ${slider.unit}`;
      slider.input.value = slider.place;
      slider.input.setAttribute("aria-valuetext", text);
      slider.output.textContent = text;
    }

    // Pictures ---------------------------------------------------------------------------------

    /* Return the drawing context of a canvas in CSS pixels, cleared. */
    context(canvas) {
      const ratio = globalThis.devicePixelRatio || 1;
      const width = canvas.clientWidth, height = canvas.clientHeight;
      if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
      if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
      const pen = canvas.getContext("2d");
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, width, height);
      pen.font = "13px sans-serif";
      pen.lineJoin = pen.lineCap = "round";
      return [pen, width, height];
    }

    draw() {
      if (!this.box) return;
      const style = getComputedStyle(this.box), color = name => style.getPropertyValue(name).trim();
      this.ink = color("--live-ink");
      this.faint = color("--live-faint");
      this.colors = [1, 2, 3].map(number => color(`--live-color-${number}`));
      this.drawArm();
      // Long curves take longer to draw than the arm to simulate: 20 times per second suffice.
      if (!this.playing || this.pictures % 3 === 0) this.drawChart();
    }

    drawArm() {
      const [pen, width, height] = this.context(this.canvas);
      if (!width) return;
      const [left, bottom, right, top] = this.scene.view;
      const scale = Math.min(width / (right - left), height / (top - bottom));
      const x = value => width / 2 + scale * (value - (left + right) / 2);
      const y = value => height / 2 - scale * (value - (bottom + top) / 2);
      pen.strokeStyle = this.faint;
      pen.fillStyle = this.ink;
      const bar = right - left > 3 ? 1 : 0.25;
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(12, height - 12);
      pen.lineTo(12 + scale * bar, height - 12);
      pen.stroke();
      pen.fillText(`${bar} m`, 12, height - 18);
      pen.fillText(`t = ${(this.sample / this.scene.rate).toFixed(2)} s`, 12, 18);
      if (this.magnify !== 1) {
        pen.textAlign = "right";
        pen.fillText(`bending drawn ${this.magnify} times as large`, width - 12, 18);
        pen.textAlign = "left";
      }
      if (!this.scene.turns) pen.fillText("axes turn with the arm", 12, 36);
      this.runs.forEach((run, number) => {
        const poses = run.poses(this.at(run), this.magnify, this.scene.turns), points = run.points();
        const each = points.length / 2 / this.scene.bodies.length;
        pen.strokeStyle = pen.fillStyle = this.colors[number];
        pen.lineWidth = 4 + 3 * (this.runs.length - 1 - number);  // all of them remain visible
        pen.beginPath();
        for (let k = 0; k < points.length / 2; k++) {
          const place = [x(points[2 * k]), y(points[2 * k + 1])];
          if (k % each) pen.lineTo(...place);
          else pen.moveTo(...place);
        }
        pen.stroke();
        for (const body of this.scene.bodies) {
          pen.beginPath();
          pen.arc(x(poses[16 * body]), y(poses[16 * body + 1]), 6, 0, 7);
          pen.fill();
        }
        this.drawPayload(pen, x(points.at(-2)), y(points.at(-1)));
      });
    }

    /* Draw a disc at the tip whose area is the mass of a slider for payloads. */
    drawPayload(pen, x, y) {
      const slider = this.scene.sliders.find(other => other.label === "payload");
      const mass = slider ? slider.values[slider.place] : 0;
      pen.beginPath();
      pen.arc(x, y, 3 + 14 * Math.sqrt(mass), 0, 7);
      pen.fill();
    }

    drawChart() {
      const [pen, width, height] = this.context(this.chart);
      if (!width) return;
      const count = this.scene.traces.length, band = height / count;
      this.scene.traces.forEach((trace, number) => {
        const top = number * band + 22, bottom = (number + 1) * band - 18;
        this.drawTrace(pen, trace, number, top, bottom, width - 12);
      });
    }

    drawTrace(pen, trace, number, top, bottom, right) {
      const left = 52, {duration, rate} = this.scene;
      let low = 0, high = 0;
      for (const run of this.runs) for (const value of run.traces[number]) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
      const span = nice(Math.max(high, -low, 1e-3));
      low = low < 0 ? -span : 0;
      high = high > 0 || low === 0 ? span : 0;
      const x = sample => left + (right - left) * sample / (duration * rate);
      const y = value => bottom - (bottom - top) * (value - low) / (high - low);
      pen.fillStyle = this.ink;
      pen.strokeStyle = this.faint;
      pen.lineWidth = 1;
      pen.fillText(`${trace.label} (${trace.unit})`, left, top - 8);
      this.drawNumbers(pen, number, top - 8, right);
      pen.textAlign = "right";
      for (const value of new Set([low, 0, high])) {
        pen.fillText(signed(value), left - 6, y(value) + 4);
        pen.beginPath();
        pen.moveTo(left, y(value));
        pen.lineTo(right, y(value));
        pen.stroke();
      }
      pen.fillText(`${duration} s`, right, bottom + 15);
      pen.textAlign = "left";
      pen.fillText("0", left, bottom + 15);
      pen.lineWidth = 1.5;
      this.runs.forEach((run, k) => {
        pen.strokeStyle = this.colors[k];
        pen.beginPath();
        run.traces[number].slice(0, this.sample + 1).forEach((value, sample) => pen.lineTo(x(sample), y(value)));
        pen.stroke();
      });
    }

    /* Write the numbers of a trace at the time shown, in the colors of the runs. */
    drawNumbers(pen, number, y, right) {
      const digits = right < 500 && this.runs.length > 1 ? 1 : 4;
      pen.textAlign = "right";
      for (const [k, run] of [...this.runs.entries()].reverse()) {
        const text = signed((run.traces[number][this.at(run)] ?? NaN).toFixed(digits));
        pen.fillStyle = this.colors[k];
        pen.fillText(text, right, y);
        right -= pen.measureText(text).width + 10;
      }
      pen.textAlign = "left";
      pen.fillStyle = this.ink;
    }
  }

  /* Return a number as text, with the minus sign of print. */
  const signed = number => String(number).replace("-", "\u2212");

  /* Return the least of 1, 2, 5, 10, ... that is not below a number. */
  function nice(number) {
    const power = 10 ** Math.floor(Math.log10(number));
    return Number((power * [1, 2, 5, 10].find(step => step * power >= number * (1 - 1e-9))).toPrecision(3));
  }

  async function begin(box) {
    try {
      const module = await WebAssembly.compile(bytesOf(flexarm.kernels));
      const player = await Player.load(box, flexarm.scenes[box.dataset.scene], module);
      (flexarm.players ??= {})[box.dataset.scene] = flexarm.player = player;
      // Play while the arm is on the screen, unless the reader prefers still pictures.
      let waits = !matchMedia("(prefers-reduced-motion: reduce)").matches;
      new IntersectionObserver(([entry]) => {
        if (entry.isIntersecting ? waits : player.playing) {
          waits = !entry.isIntersecting;
          player.play(entry.isIntersecting);
        }
      }).observe(player.canvas);
    } catch (error) {
      box.textContent = `This page needs WebAssembly and a current browser: ${error.message}`;
      throw error;
    }
  }

  Object.assign(flexarm, {Run, Player});
  Object.defineProperty(flexarm, "state", {get: () => flexarm.player?.state});
  if (globalThis.document) for (const box of document.querySelectorAll(".live")) begin(box);
})();
