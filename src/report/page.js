'use strict';
(() => {
  // The values of all halves, indexed by their bits.
  const FLOATS = (() => {
    const table = new Float32Array(65536);
    for (let bits = 0; bits < 65536; bits++) {
      const exponent = (bits >> 10) & 31, fraction = bits & 1023;
      const size = exponent === 0 ? fraction * 2 ** -24
        : exponent === 31 ? (fraction ? NaN : Infinity) : (1 + fraction / 1024) * 2 ** (exponent - 15);
      table[bits] = bits & 32768 ? -size : size;
    }
    return table;
  })();

  // Inferno [Smith and van der Walt 2015], approximated by Zucker's polynomials as in src/compare/heat.rs.
  const INFERNO = [
    [0.000218940369119, 0.001651004631001, -0.019480898437092],
    [0.106513419485612, 0.563956436788409, 3.932712388889277],
    [11.60249308247187, -3.972853965665698, -15.9423941062914],
    [-41.70399613139459, 17.43639888205313, 44.35414519872813],
    [77.162935699427, -33.40235894210092, -81.80730925738993],
    [-71.31942824499214, 32.62606426397723, 73.20951985803202],
    [25.13112622477341, -12.24266895238567, -23.07032500287172],
  ];
  const HEAT = (() => {
    const table = new Uint8ClampedArray(3 * 1024);
    for (let i = 0; i < 1024; i++) {
      for (let c = 0; c < 3; c++) {
        table[3 * i + c] = 255 * INFERNO.reduceRight((sum, k) => sum * (i / 1023) + k[c], 0);
      }
    }
    return table;
  })();
  const INVALID = [0, 255, 255];

  // Returns the sRGB codes of all halves at an exposure.
  function codes(exposure) {
    const table = new Uint8ClampedArray(65536), scale = 2 ** exposure;
    for (let bits = 0; bits < 65536; bits++) {
      const v = Math.min(Math.max(FLOATS[bits] * scale, 0), 1);
      table[bits] = 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
    }
    return table;
  }

  // Unpacks the planes of red, green and blue. In each plane, the low bytes precede the high bytes.
  async function unpack(text, count) {
    const packed = atob(text.trim()), bytes = new Uint8Array(packed.length);
    for (let i = 0; i < packed.length; i++) bytes[i] = packed.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
    const raw = new Uint8Array(await new Response(stream).arrayBuffer());
    return [0, 1, 2].map((c) => {
      const plane = new Uint16Array(count), low = 2 * c * count, high = low + count;
      for (let i = 0; i < count; i++) plane[i] = raw[low + i] | (raw[high + i] << 8);
      return plane;
    });
  }

  const relative = (x, r) => (x - r) ** 2 / (r * r + 0.01);
  const shown = (v) => (Number.isFinite(v) ? (v === 0 ? '0' : Math.abs(v) >= 1e-3 && Math.abs(v) < 1e4
    ? v.toPrecision(4) : v.toExponential(2)) : String(v)).padStart(9);

  class Viewer {
    constructor(figure) {
      this.figure = figure;
      const find = (selector) => figure.querySelector(selector);
      const data = figure.dataset;
      [this.width, this.height] = [Number(data.width), Number(data.height)];
      this.reference = data.reference === '' ? null : Number(data.reference);
      [this.heatMax, this.decades] = [Number(data.heatMax), Number(data.heatDecades)];
      this.stage = find('.stage'); this.canvas = find('canvas'); this.divider = find('.divider');
      this.packed = [...figure.querySelectorAll('.pixels')];
      this.buttons = [...figure.querySelectorAll('.images button')];
      this.names = this.buttons.map((button) => button.textContent);
      this.unpacked = [];
      this.sides = [{ choice: data.left }, { choice: data.right }];
      this.picks = [find('.pick-left'), find('.pick-right')];
      this.tags = [find('.at-left'), find('.at-right')];
      this.split = 0.5;
      this.zoom = null; // Device-independent pixels per image pixel; null fits the stage.
      this.centre = [this.width / 2, this.height / 2];
      this.exposure = Number(data.exposure);
      this.pointers = new Map();
      this.build(find);
    }

    build(find) {
      for (const [side, pick] of this.picks.entries()) {
        this.names.forEach((name, i) => pick.add(new Option(name, String(i))));
        if (this.reference !== null) {
          this.names.forEach((name, i) => {
            if (i !== this.reference) pick.add(new Option(`error of ${name}`, `e${i}`));
          });
        }
        pick.value = this.sides[side].choice;
        pick.addEventListener('change', () => this.choose(side, pick.value));
      }
      this.buttons.forEach((button, i) => button.addEventListener('click', () => this.choose(1, String(i))));
      const slider = find('.exposure');
      slider.value = this.exposure;
      slider.addEventListener('input', () => { this.exposure = Number(slider.value); this.repaint(); });
      slider.addEventListener('dblclick', () => { slider.value = 0; slider.dispatchEvent(new Event('input')); });
      this.ev = find('.ev'); this.percent = find('.scale'); this.readout = find('.readout'); this.heat = find('.heat');
      find('.in').addEventListener('click', () => this.zoomBy(2));
      find('.out').addEventListener('click', () => this.zoomBy(0.5));
      find('.fit').addEventListener('click', () => { this.zoom = null; this.draw(); });
      find('.one').addEventListener('click', () => { this.zoom = 1 / devicePixelRatio; this.draw(); });
      for (const element of [find('.controls'), this.stage, this.readout]) element.hidden = false;
      this.stage.style.aspectRatio = `${this.width} / ${this.height}`;
      this.listen();
      new ResizeObserver(() => this.draw()).observe(this.stage);
      this.repaint();
    }

    listen() {
      const canvas = this.canvas;
      const slide = (event) => {
        const box = this.stage.getBoundingClientRect();
        this.slideTo((event.clientX - box.left) / box.width);
      };
      this.divider.addEventListener('pointerdown', (event) => {
        this.divider.setPointerCapture(event.pointerId);
        event.preventDefault();
        this.divider.focus({ preventScroll: true });
      });
      this.divider.addEventListener('pointermove', (event) => {
        if (this.divider.hasPointerCapture(event.pointerId)) slide(event);
      });
      const keys = (event) => {
        const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
        if (step) this.slideTo(this.split + step);
        else if (event.key === 'Home') this.slideTo(0);
        else if (event.key === 'End') this.slideTo(1);
        else if (event.key === '+' || event.key === '=') this.zoomBy(2);
        else if (event.key === '-') this.zoomBy(0.5);
        else if (event.key === '0') { this.zoom = null; this.draw(); } else return;
        event.preventDefault();
      };
      this.divider.addEventListener('keydown', keys);
      canvas.addEventListener('keydown', keys);
      canvas.addEventListener('wheel', (event) => {
        if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;
        event.preventDefault();
        this.zoomBy(2 ** (-event.deltaY / 200), event);
      }, { passive: false });
      canvas.addEventListener('dblclick', (event) => this.zoomBy(event.shiftKey ? 0.5 : 2, event));
      canvas.addEventListener('pointerdown', (event) => {
        canvas.setPointerCapture(event.pointerId);
        this.pointers.set(event.pointerId, event);
      });
      canvas.addEventListener('pointermove', (event) => { this.drag(event, slide); this.tell(event); });
      for (const end of ['pointerup', 'pointercancel']) {
        canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
      }
      canvas.addEventListener('pointerleave', () => this.tell(null));
    }

    // One pointer pans, or moves the divider if the image fits the stage; two pointers zoom.
    drag(event, slide) {
      const before = this.pointers.get(event.pointerId);
      if (!before) return;
      const others = [...this.pointers.values()].filter((p) => p.pointerId !== event.pointerId);
      this.pointers.set(event.pointerId, event);
      if (others.length === 1) {
        const distance = (p) => Math.hypot(p.clientX - others[0].clientX, p.clientY - others[0].clientY);
        this.zoomBy(distance(event) / Math.max(distance(before), 1), event);
      } else if (this.zoom === null) {
        slide(event);
      } else {
        this.centre[0] -= (event.clientX - before.clientX) / this.zoom;
        this.centre[1] -= (event.clientY - before.clientY) / this.zoom;
        this.draw();
      }
    }

    slideTo(share) {
      this.split = Math.min(Math.max(share, 0), 1);
      this.draw();
    }

    fit() {
      return Math.min(this.canvas.clientWidth / this.width, this.canvas.clientHeight / this.height) || 1;
    }

    // Zooms about the position of the event, or about the centre.
    zoomBy(factor, event) {
      const old = this.zoom ?? this.fit();
      if (this.zoom === null) this.centre = [this.width / 2, this.height / 2];
      const zoom = Math.min(Math.max(old * factor, Math.min(this.fit(), 1) / 4), 128);
      if (event) {
        const [x, y] = this.imagePoint(event, old);
        this.centre = [x + (this.centre[0] - x) * old / zoom, y + (this.centre[1] - y) * old / zoom];
      }
      this.zoom = zoom;
      this.draw();
    }

    imagePoint(event, zoom) {
      const box = this.canvas.getBoundingClientRect();
      return [
        this.centre[0] + (event.clientX - box.left - box.width / 2) / zoom,
        this.centre[1] + (event.clientY - box.top - box.height / 2) / zoom,
      ];
    }

    choose(side, choice) {
      this.sides[side].choice = choice;
      this.picks[side].value = choice;
      return this.repaint();
    }

    // Returns the planes of an image, which are unpacked at their first use.
    planes(i) {
      this.unpacked[i] ??= unpack(this.packed[i].textContent, this.width * this.height);
      return this.unpacked[i];
    }

    // Repaints both sides, and again if choices or exposure changed during painting.
    async repaint() {
      this.stale = true;
      if (this.painting) return;
      this.painting = true;
      while (this.stale) {
        this.stale = false;
        for (const side of this.sides) await this.paint(side);
      }
      this.painting = false;
      this.sides.forEach(({ choice }, i) => {
        this.tags[i].textContent = this.picks[i].selectedOptions[0].text;
        this.picks[i].value = choice;
      });
      this.buttons.forEach((b, i) => b.classList.toggle('shown', this.sides.some((s) => s.choice === String(i))));
      this.heat.hidden = !this.sides.some((s) => s.choice.startsWith('e'));
      this.ev.textContent = `${this.exposure < 0 ? '−' : '+'}${Math.abs(this.exposure)} EV`;
      this.draw();
      this.figure.dataset.ready = 'true';
    }

    async paint(side) {
      const { choice } = side, isError = choice.startsWith('e');
      const key = isError ? choice : `${choice} ${this.exposure}`;
      if (side.key === key) return;
      const planes = await this.planes(Number(isError ? choice.slice(1) : choice));
      const pixels = new ImageData(this.width, this.height);
      if (isError) this.paintError(pixels.data, planes, await this.planes(this.reference));
      else this.paintColour(pixels.data, planes);
      side.canvas ??= Object.assign(document.createElement('canvas'), { width: this.width, height: this.height });
      side.canvas.getContext('2d').putImageData(pixels, 0, 0);
      side.key = key;
    }

    paintColour(to, planes) {
      const table = codes(this.exposure);
      for (let i = 0; i < planes[0].length; i++) {
        const valid = planes.every((plane) => (plane[i] & 0x7c00) !== 0x7c00);
        for (let c = 0; c < 3; c++) to[4 * i + c] = valid ? table[planes[c][i]] : INVALID[c];
        to[4 * i + 3] = 255;
      }
    }

    paintError(to, planes, reference) {
      for (let i = 0; i < planes[0].length; i++) {
        const error = this.errorAt(planes, reference, i);
        const t = 1 + Math.log10(error / this.heatMax) / this.decades;
        const at = 3 * Math.round(1023 * Math.min(Math.max(t, 0), 1));
        for (let c = 0; c < 3; c++) to[4 * i + c] = Number.isFinite(error) ? HEAT[at + c] : INVALID[c];
        to[4 * i + 3] = 255;
      }
    }

    errorAt(planes, reference, i) {
      return planes.reduce((sum, plane, c) => sum + relative(FLOATS[plane[i]], FLOATS[reference[c][i]]), 0) / 3;
    }

    draw() {
      const canvas = this.canvas, ratio = devicePixelRatio;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight];
      if (!width || !this.sides.every((side) => side.canvas)) return;
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
      const context = canvas.getContext('2d');
      const zoom = this.zoom ?? this.fit();
      const clamp = (v, size, room) => {
        const half = room / zoom / 2;
        return half >= size / 2 ? size / 2 : Math.min(Math.max(v, half), size - half);
      };
      this.centre = [clamp(this.centre[0], this.width, width), clamp(this.centre[1], this.height, height)];
      const split = Math.round(this.split * canvas.width);
      this.sides.forEach((side, i) => {
        context.save();
        context.beginPath();
        context.rect(i ? split : 0, 0, i ? canvas.width - split : split, canvas.height);
        context.clip();
        context.imageSmoothingEnabled = zoom * ratio < 1;
        context.imageSmoothingQuality = 'high';
        context.drawImage(side.canvas, canvas.width / 2 - this.centre[0] * zoom * ratio,
          canvas.height / 2 - this.centre[1] * zoom * ratio, this.width * zoom * ratio, this.height * zoom * ratio);
        context.restore();
      });
      this.divider.style.left = `${this.split * 100}%`;
      this.divider.setAttribute('aria-valuenow', String(Math.round(this.split * 100)));
      this.stage.classList.toggle('zoomed', this.zoom !== null && this.zoom > this.fit() * 1.001);
      this.percent.textContent = `${Number((zoom * ratio * 100).toPrecision(3))} %`;
    }

    // Shows the values of the pixel under the pointer.
    async tell(event) {
      if (!event) { this.readout.replaceChildren(); return; }
      const [x, y] = this.imagePoint(event, this.zoom ?? this.fit()).map(Math.floor);
      if (x < 0 || y < 0 || x >= this.width || y >= this.height) { this.readout.replaceChildren(); return; }
      const at = y * this.width + x;
      const lines = [`pixel ${x}, ${y}`];
      const reference = this.reference === null ? null : await this.planes(this.reference);
      for (const [i, side] of this.sides.entries()) {
        const index = Number(side.choice.replace('e', '')), planes = await this.planes(index);
        const values = planes.map((plane) => shown(FLOATS[plane[at]])).join(' ');
        const error = reference && index !== this.reference
          ? `, error ${this.errorAt(planes, reference, at).toExponential(2)}` : '';
        lines.push(`${i ? 'right' : 'left '} ${values}${error}`);
      }
      this.readout.replaceChildren(...lines.map((line) => Object.assign(document.createElement('span'), { textContent: line })));
    }
  }

  if (typeof DecompressionStream === 'function' && typeof ResizeObserver === 'function') {
    for (const figure of document.querySelectorAll('.viewer')) new Viewer(figure);
  }
})();
