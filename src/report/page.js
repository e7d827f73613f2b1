(() => {
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

  class Viewer extends Stage {
    constructor(figure) {
      const data = figure.dataset;
      super(figure, Number(data.width), Number(data.height), Number(data.exposure));
      const find = (selector) => figure.querySelector(selector);
      this.reference = data.reference === '' ? null : Number(data.reference);
      [this.heatMax, this.decades] = [Number(data.heatMax), Number(data.heatDecades)];
      this.divider = find('.divider');
      this.packed = [...figure.querySelectorAll('.pixels')];
      this.buttons = [...figure.querySelectorAll('.images button')];
      this.names = this.buttons.map((button) => button.textContent);
      this.unpacked = [];
      this.sides = [{ choice: data.left }, { choice: data.right }];
      this.picks = [find('.pick-left'), find('.pick-right')];
      this.tags = [find('.at-left'), find('.at-right')];
      this.split = 0.5;
      this.build();
    }

    build() {
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
      super.build();
      this.repaint();
    }

    listen() {
      this.divider.addEventListener('pointerdown', (event) => {
        this.divider.setPointerCapture(event.pointerId);
        event.preventDefault();
        this.divider.focus({ preventScroll: true });
      });
      this.divider.addEventListener('pointermove', (event) => {
        if (this.divider.hasPointerCapture(event.pointerId)) this.slide(event);
      });
      this.divider.addEventListener('keydown', (event) => this.key(event));
      super.listen();
    }

    key(event) {
      const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
      if (step) this.slideTo(this.split + step);
      else if (event.key === 'Home') this.slideTo(0);
      else if (event.key === 'End') this.slideTo(1);
      else { super.key(event); return; }
      event.preventDefault();
    }

    // Moves the divider to the pointer.
    slide(event) {
      const box = this.stage.getBoundingClientRect();
      this.slideTo((event.clientX - box.left) / box.width);
    }

    slideTo(share) {
      this.split = Math.min(Math.max(share, 0), 1);
      this.draw();
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
      this.ev.textContent = this.exposureText();
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
      else paintColour(pixels.data, planes, this.exposure);
      side.canvas ??= Object.assign(document.createElement('canvas'), { width: this.width, height: this.height });
      side.canvas.getContext('2d').putImageData(pixels, 0, 0);
      side.key = key;
    }

    paintError(to, planes, reference) {
      paintHeat(to, planes[0].length, (i) => this.errorAt(planes, reference, i), this.heatMax, this.decades);
    }

    errorAt(planes, reference, i) {
      return planes.reduce((sum, plane, c) => sum + relative(FLOATS[plane[i]], FLOATS[reference[c][i]]), 0) / 3;
    }

    isPainted() {
      return this.sides.every((side) => side.canvas);
    }

    drawImages(context, draw) {
      const { width, height } = this.canvas, split = Math.round(this.split * width);
      this.sides.forEach((side, i) => {
        context.save();
        context.beginPath();
        context.rect(i ? split : 0, 0, i ? width - split : split, height);
        context.clip();
        draw(side.canvas);
        context.restore();
      });
      this.divider.style.left = `${this.split * 100}%`;
      this.divider.setAttribute('aria-valuenow', String(Math.round(this.split * 100)));
    }

    // Shows the values of the pixel under the pointer.
    async tell(event) {
      const pixel = event && this.pixelAt(event);
      if (!pixel) { this.read([]); return; }
      const [at, x, y] = pixel;
      const lines = [`pixel ${x}, ${y}`];
      const reference = this.reference === null ? null : await this.planes(this.reference);
      for (const [i, side] of this.sides.entries()) {
        const index = Number(side.choice.replace('e', '')), planes = await this.planes(index);
        const values = planes.map((plane) => shown(FLOATS[plane[at]])).join(' ');
        const error = reference && index !== this.reference
          ? `, error ${this.errorAt(planes, reference, at).toExponential(2)}` : '';
        lines.push(`${i ? 'right' : 'left '} ${values}${error}`);
      }
      this.read(lines);
    }
  }

  if (typeof DecompressionStream === 'function' && typeof ResizeObserver === 'function') {
    for (const figure of document.querySelectorAll('.viewer')) new Viewer(figure);
  }
})();
