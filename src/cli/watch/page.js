(() => {
  const byId = (id) => document.getElementById(id);
  const HEAT_MAX = 1, HEAT_DECADES = 3;
  const REASONS = {
    samples: 'all samples are taken', time: 'the time is up', error: 'the error is reached',
    enough: 'that was enough', interrupted: 'it was stopped',
  };
  // The time after which another attempt is made to reach the render, and the number of attempts.
  const RETRY = 500, ATTEMPTS = 4;

  // The picture of the render, which changes.
  class Live extends Stage {
    constructor(figure) {
      super(figure, 1, 1, 0);
      this.number = 0;
      this.image = document.createElement('canvas');
      this.pick = figure.querySelector('.pick');
      this.pick.addEventListener('change', () => this.repaint());
      const colours = Array.from({ length: 16 }, (_, i) => {
        const at = 3 * Math.round(1023 * i / 15);
        return `rgb(${HEAT[at]}, ${HEAT[at + 1]}, ${HEAT[at + 2]})`;
      });
      figure.querySelector('.heat i').style.background = `linear-gradient(90deg, ${colours.join(', ')})`;
    }

    // Takes a picture: its number, width, height and number of planes, then the planes of halves.
    put(buffer) {
      const [number, width, height, count] = new Uint32Array(buffer, 0, 4);
      const area = width * height;
      this.planes = Array.from({ length: count }, (_, i) => new Uint16Array(buffer, 16 + 2 * area * i, area));
      if (width !== this.width || height !== this.height || !this.number) {
        [this.width, this.height] = [this.image.width, this.image.height] = [width, height];
        this.zoom = null;
        if (this.number) this.stage.style.aspectRatio = `${width} / ${height}`;
        else this.build();
        byId('none').hidden = true;
      }
      this.number = number;
      this.repaint();
    }

    repaint() {
      const pixels = new ImageData(this.width, this.height), isError = this.pick.value === 'error';
      const [colours, errors] = [this.planes.slice(0, 3), this.planes[3]];
      if (isError) paintHeat(pixels.data, errors.length, (i) => FLOATS[errors[i]], HEAT_MAX, HEAT_DECADES);
      else paintColour(pixels.data, colours, this.exposure);
      this.image.getContext('2d').putImageData(pixels, 0, 0);
      this.heat.hidden = !isError;
      this.ev.textContent = this.exposureText();
      this.draw();
      this.figure.dataset.ready = 'true';
      this.tell(this.last);
    }

    isPainted() {
      return this.number > 0;
    }

    drawImages(context, draw) {
      draw(this.image);
    }

    // Shows the values of the pixel under the pointer.
    tell(event) {
      this.last = event;
      const pixel = event && this.pixelAt(event);
      if (!pixel) { this.read([]); return; }
      const [at, x, y] = pixel, values = this.planes.map((plane) => FLOATS[plane[at]]);
      const error = Number.isFinite(values[3]) ? `${(100 * values[3]).toPrecision(3)} %` : 'unknown';
      this.read([`pixel ${x}, ${y}`, values.slice(0, 3).map(shown).join(' '), `relative standard error ${error}`]);
    }
  }

  function duration(seconds) {
    if (seconds < 60) return `${seconds < 10 ? seconds.toFixed(1) : Math.round(seconds)} s`;
    const minutes = Math.round(seconds / 60);
    return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
  }

  const SUPERSCRIPTS = '⁰¹²³⁴⁵⁶⁷⁸⁹';
  // Returns a number as 0.05, 20 or 2·10⁻⁵.
  function short(v) {
    const power = Math.floor(Math.log10(v) + 1e-9);
    if (power >= -2 && power < 5) return String(Number(v.toPrecision(2)));
    const digits = String(Math.abs(power)).replace(/\d/g, (d) => SUPERSCRIPTS[d]);
    const factor = Number((v / 10 ** power).toPrecision(2));
    return `${factor === 1 ? '' : `${factor}·`}10${power < 0 ? '⁻' : ''}${digits}`;
  }

  // Returns the labelled values of a logarithmic axis.
  function ticks(low, high) {
    const few = Math.log10(high / low) < 2.2, all = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) {
      for (const factor of few ? [1, 2, 5] : [1]) {
        const value = Number(`${factor}e${power}`);
        if (value >= low && value <= high) all.push(value);
      }
    }
    const step = Math.ceil(all.length / 8);
    return all.filter((_, i) => i % step === 0);
  }

  // Draws the relMSE and its interval against time, both on logarithmic axes.
  function plot(history, target) {
    const svg = byId('plot'), [left, right, top, bottom] = [54, 374, 8, 224];
    const points = history.filter((p) => p.every((v) => v > 0));
    const add = (tag, attributes, text) => {
      const element = document.createElementNS('http://www.w3.org/2000/svg', tag);
      for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
      if (text) element.textContent = text;
      parts.push(element);
    };
    const parts = [];
    if (points.length < 2) {
      add('text', { x: 190, y: 120, 'text-anchor': 'middle', class: 'label' }, 'The plot needs two estimates.');
      svg.replaceChildren(...parts);
      return;
    }
    const times = points.map((p) => p[0]), values = points.flatMap((p) => p.slice(1)).concat(target ?? []);
    const range = (all, margin) => [Math.min(...all) / margin, Math.max(...all) * margin];
    const [t0, t1] = range(times, 1.05), [e0, e1] = range(values, 1.2);
    const x = (t) => left + (right - left) * Math.log(t / t0) / Math.log(t1 / t0);
    const y = (e) => bottom - (bottom - top) * Math.log(e / e0) / Math.log(e1 / e0);
    const path = (list) => list.map(([a, b]) => `${x(a).toFixed(1)},${y(b).toFixed(1)}`).join(' ');
    for (const t of ticks(t0, t1)) {
      add('line', { x1: x(t), x2: x(t), y1: top, y2: bottom, class: 'grid' });
      add('text', { x: x(t), y: bottom + 18, 'text-anchor': 'middle', class: 'label' }, short(t));
    }
    for (const e of ticks(e0, e1)) {
      add('line', { x1: left, x2: right, y1: y(e), y2: y(e), class: 'grid' });
      add('text', { x: left - 8, y: y(e) + 4, 'text-anchor': 'end', class: 'label' }, short(e));
    }
    add('text', { x: (left + right) / 2, y: 264, 'text-anchor': 'middle', class: 'label' }, 'time in s');
    if (target) {
      add('polyline', { points: path([[t0, target], [t1, target]]), class: 'line s1', 'stroke-dasharray': '6 4' });
      add('text', { x: right - 4, y: y(target) - 5, 'text-anchor': 'end', class: 'label' }, 'target of the upper end');
    }
    const band = points.map((p) => [p[0], p[3]]).concat(points.map((p) => [p[0], p[2]]).reverse());
    add('polygon', { points: path(band), class: 'band s0' });
    add('polyline', { points: path(points), class: 'line s0' });
    svg.replaceChildren(...parts);
  }

  // Shows the rules that may end the render.
  function left({ samples_per_pixel: samples, seconds, relmse_interval: interval, rules, seconds_left: eta }, ended) {
    const rows = [
      ['Samples per pixel', rules.samples === null ? String(samples) : `${samples} of ${rules.samples}`],
      ['Time', rules.seconds === null ? duration(seconds) : `${duration(seconds)} of ${duration(rules.seconds)}`],
    ];
    if (rules.relmse !== null) {
      rows.push(['relMSE', `${interval ? `at most ${short(interval[1])}` : 'unknown'}, target ${short(rules.relmse)}`]);
    }
    const hasRule = Object.values(rules).some((rule) => rule !== null);
    const rest = ended ? 'nothing' : eta !== null ? `about ${duration(eta)}` : hasRule ? 'unknown' : 'until it is stopped';
    rows.push(['Left', rest]);
    const element = (tag, text) => Object.assign(document.createElement(tag), { textContent: text });
    byId('left').replaceChildren(...rows.flatMap(([name, text]) => [element('dt', name), element('dd', text)]));
  }

  function status({ phase, progress, stop_reason: reason, exit_code: code, message }) {
    switch (phase) {
      case 'loading': return 'Loading the scene.';
      case 'preparing': return 'Preparing the integrator.';
      case 'rendering': {
        const share = progress.share === null ? '' : `: ${(100 * progress.share).toFixed(1)} %`;
        if (pressed.stop) return `Stopping${share}.`;
        if (pressed.enough) return `Finishing the current part of the pass${share}.`;
        return `Rendering${share}${progress.seconds_left === null ? '' : `, about ${duration(progress.seconds_left)} left`}.`;
      }
      case 'writing': return `Sampling has ended, because ${REASONS[reason]}. Writing the image.`;
      case 'failed': return `Failed with exit code ${code}: ${message}`;
      default: return `Finished with exit code ${code}${reason ? `, because ${REASONS[reason]}` : ''}.`;
    }
  }

  const live = new Live(document.querySelector('.viewer'));
  const pressed = { enough: false, stop: false };
  let render = null;

  function show(state) {
    const { phase, progress, frame } = state, ended = state.exit_code !== null;
    const name = `${state.name ?? 'Buffon'}${frame === null ? '' : `, frame ${frame}`}`;
    if (render !== name) [render, pressed.enough] = [name, false];
    byId('name').textContent = name;
    byId('status').textContent = status(state);
    document.title = progress?.share != null && !ended ? `${(100 * progress.share).toFixed(0)} % ${name}` : name;
    const bar = byId('bar');
    if (progress?.share != null) bar.value = progress.share;
    else if (ended) bar.value = 1;
    else bar.removeAttribute('value');
    byId('enough').disabled = pressed.enough || pressed.stop || !['preparing', 'rendering'].includes(phase);
    byId('stop').disabled = pressed.stop || ended;
    if (progress) {
      left(progress, ended || phase === 'writing');
      plot(state.history, progress.rules.relmse);
      const interval = progress.relmse_interval;
      byId('now').textContent = interval
        ? `Now ${short(progress.relmse_estimate)}, with 95 % between ${short(interval[0])} and ${short(interval[1])}.` : '';
    }
    document.body.dataset.phase = phase;
  }

  function press(name) {
    byId(name).addEventListener('click', async () => {
      pressed[name] = true;
      byId(name).disabled = true;
      // A render that ends at once cannot answer.
      const answer = await fetch(name, { method: 'POST' }).catch(() => null);
      if (answer && !answer.ok) byId('hint').textContent = await answer.text();
    });
  }

  // Follows the render: the answer comes when something has changed, or after a second.
  async function follow() {
    let number = '';
    for (let attempt = 0; attempt < ATTEMPTS;) {
      try {
        const state = await (await fetch(`state?after=${number}&have=${live.number}`)).json();
        show(state);
        if (state.picture !== null && state.picture !== live.number) {
          const answer = await fetch('picture');
          if (answer.ok) live.put(await answer.arrayBuffer());
        }
        if (state.exit_code !== null) return;
        [number, attempt] = [state.state, 0];
      } catch {
        attempt += 1;
        await new Promise((resolve) => setTimeout(resolve, RETRY));
      }
    }
    byId('status').textContent = 'The render has ended or cannot be reached. This is its last picture.';
    byId('enough').disabled = byId('stop').disabled = true;
    document.body.dataset.phase = 'gone';
  }

  press('enough');
  press('stop');
  follow();
})();
