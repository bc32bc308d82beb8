/* Arms that are simulated in the page, by the compiled kernels of the package.

   A *run* is the memory that Python's `simulate` had before its first step. Its equations, steps and
   poses are those of the kernels; this file sets numbers of sliders, calls the kernels and draws. */
"use strict";
(() => {
  const TYPES = {f8: Float64Array, i8: BigInt64Array, i4: Int32Array, i2: Int16Array, i1: Int8Array};
  // Places of `flexarm.integrate.memory` and `sampled_law`, and codes of `flexarm.integrate.status`.
  const TIME = 0, STEP = 1, SAMPLES = 0, TICK = 0, LAST = 1, END = 3;
  const COMPLETE = 0, BENT = 2, REFUSED = 3, DONE = 0, PAUSED = 1;

  const bytesOf = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const numbersOf = text => new Float64Array(bytesOf(text).buffer);

  async function inflated(text) {
    const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /* One simulated arm, in a memory of its own. */
  class Run {
    static async load(module, image) {
      const {exp, log, pow} = Math, run = new Run();
      run.kernels = (await WebAssembly.instantiate(module, {env: {exp, log, pow}})).exports;
      run.image = image;
      run.initial = await inflated(image.data);
      const {memory, __heap_base} = run.kernels;
      run.base = Math.ceil(__heap_base.value / 16) * 16;
      const missing = run.base + image.size - memory.buffer.byteLength;
      if (missing > 0) memory.grow(Math.ceil(missing / 65536));
      run.arrays = {};
      for (const [name, [place, type, shape]] of Object.entries(image.arrays)) {
        const count = shape.reduce((product, length) => product * length, 1);
        run.arrays[name] = new TYPES[type](memory.buffer, run.base + place, count);
      }
      run.view = new DataView(memory.buffer);
      run.sampled = "sampled" in image.tables;
      run.reset();
      return run;
    }

    /* Return to the start; the numbers of sliders must be set again. */
    reset() {
      new Uint8Array(this.kernels.memory.buffer).set(this.initial, this.base);
      for (const place of this.image.addresses) {
        const word = this.base + place;
        this.view.setUint32(word, this.view.getUint32(word, true) + this.base, true);
      }
    }

    number(name, value) {
      this.view.setFloat64(this.base + this.image.numbers[name], value, true);
    }

    /* After a change of the arm, continue as Python does: without memory of earlier steps. */
    forget() {
      const clock = this.arrays["memory.clock"], {[TIME]: time, [STEP]: step} = clock;
      clock.fill(0);
      clock[TIME] = time;
      clock[STEP] = step;
    }

    get time() { return this.arrays["memory.clock"][TIME]; }
    get samples() { return Number(this.arrays["memory.counts"][SAMPLES]); }
    get last() { return this.arrays["memory.sample_times"].length - 1; }

    call(kernel) { return this.kernels[kernel](this.base + this.image.tables[kernel]); }

    /* Advance until a sample (0 is that at the start) is computed. Returns an error, or "". */
    advance(sample) {
      return this.sampled ? this.bySamples(sample) : this.bySteps(sample);
    }

    bySteps(sample) {
      this.integer("most_steps", 1);
      while (this.samples <= sample) {
        const status = this.call("advance");
        if (status === DONE) break;
        if (status !== PAUSED) return failure(status);
      }
      return "";
    }

    bySamples(sample) {
      const counts = this.arrays["law.counts"], law = this.arrays["law.times"];
      const rows = this.arrays["law.inputs.rows"] ?? null;
      const end = Math.ceil(law[1] / law[0] * (1 - 1e-12));
      while (this.samples <= sample && Number(counts[TICK]) < end) {
        const wanted = Math.ceil(this.arrays["memory.sample_times"][sample] / law[0]);
        const last = Math.min(end, Math.max(wanted, Number(counts[TICK]) + 1));
        const error = this.toTick(last);
        if (error) return error;
      }
      return "";
    }

    /* Advance to a sample of the controller. */
    toTick(last) {
      const counts = this.arrays["law.counts"];
      counts[LAST] = BigInt(last);
      counts[END] = BigInt(REFUSED);
      let status; try {status = this.call("sampled");} catch(e) {console.error(last, this.arrays["law.counts"], this.arrays["law.times"], this.time, this.arrays["law.commands"].slice(0,4), this.image.arrays["law.inputs"], this.image.arrays["law.commands"], this.image.arrays["law.program.code"]); throw e;}
      if (status !== DONE) return failure(status);
      if (Number(counts[END]) === BENT) return "a link has bent by many times its length";
      if (Number(counts[TICK]) < last) return "the torques are not finite";
      return "";
    }

    integer(name, value) {
      this.view.setBigInt64(this.base + this.image.numbers[name], BigInt(value), true);
    }

    /* The state at a sample: coordinates, then rates. */
    state(sample) {
      const size = this.arrays["memory.state"].length;
      return this.arrays["memory.samples"].subarray(sample * size, (sample + 1) * size);
    }

    /* Compute the poses of a sample with bending times `factor`: see `observables.poses`. */
    pose(sample, factor) {
      const drawn = this.arrays.drawn, [, bodies, places] = this.image.arrays["memory.state"][2];
      drawn.set(this.state(sample));
      for (let k = 0; k < drawn.length; k++) if (k % places) drawn[k] *= factor;
      this.call("poses");
      return this.arrays.poses;
    }

    /* Points of the axis of a sample, x and y in m. */
    points(sample, factor) {
      this.pose(sample, factor);
      this.call("axis");
      return this.arrays.points;
    }
  }
