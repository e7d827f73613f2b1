'use strict';
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

const shown = (v) => (Number.isFinite(v) ? (v === 0 ? '0' : Math.abs(v) >= 1e-3 && Math.abs(v) < 1e4
  ? v.toPrecision(4) : v.toExponential(2)) : String(v)).padStart(9);

// Paints planes of halves.
function paintColour(to, planes, exposure) {
  const table = codes(exposure);
  for (let i = 0; i < planes[0].length; i++) {
    const valid = planes.every((plane) => (plane[i] & 0x7c00) !== 0x7c00);
    for (let c = 0; c < 3; c++) to[4 * i + c] = valid ? table[planes[c][i]] : INVALID[c];
    to[4 * i + 3] = 255;
  }
}

// Paints the errors of `count` pixels in false colours, over powers of ten up to `max`.
function paintHeat(to, count, errorAt, max, decades) {
  for (let i = 0; i < count; i++) {
    const error = errorAt(i);
    const t = 1 + Math.log10(error / max) / decades;
    const at = 3 * Math.round(1023 * Math.min(Math.max(t, 0), 1));
    for (let c = 0; c < 3; c++) to[4 * i + c] = Number.isFinite(error) ? HEAT[at + c] : INVALID[c];
    to[4 * i + 3] = 255;
  }
}

// A canvas with images of one size. Zoom and pan are here; a subclass has `repaint` for a new exposure, `drawImages`,
// `tell` for the pixel under the pointer, and may handle keys and the dragging of an image that fits.
class Stage {
  constructor(figure, width, height, exposure) {
    this.figure = figure;
    [this.width, this.height] = [width, height];
    this.stage = figure.querySelector('.stage'); this.canvas = figure.querySelector('canvas');
    this.zoom = null; // Device-independent pixels per image pixel; null fits the stage.
    this.centre = [this.width / 2, this.height / 2];
    this.exposure = exposure;
    this.pointers = new Map();
  }

  build() {
    const find = (selector) => this.figure.querySelector(selector);
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
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener('keydown', (event) => this.key(event));
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
    canvas.addEventListener('pointermove', (event) => { this.drag(event); this.tell(event); });
    for (const end of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener('pointerleave', () => this.tell(null));
  }

  key(event) {
    if (event.key === '+' || event.key === '=') this.zoomBy(2);
    else if (event.key === '-') this.zoomBy(0.5);
    else if (event.key === '0') { this.zoom = null; this.draw(); } else return;
    event.preventDefault();
  }

  // Is called when an image that fits the stage is dragged.
  slide() {}

  // One pointer pans if the image does not fit the stage; two pointers zoom.
  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const others = [...this.pointers.values()].filter((p) => p.pointerId !== event.pointerId);
    this.pointers.set(event.pointerId, event);
    if (others.length === 1) {
      const distance = (p) => Math.hypot(p.clientX - others[0].clientX, p.clientY - others[0].clientY);
      this.zoomBy(distance(event) / Math.max(distance(before), 1), event);
    } else if (this.zoom === null) {
      this.slide(event);
    } else {
      this.centre[0] -= (event.clientX - before.clientX) / this.zoom;
      this.centre[1] -= (event.clientY - before.clientY) / this.zoom;
      this.draw();
    }
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

  exposureText() {
    return `${this.exposure < 0 ? '−' : '+'}${Math.abs(this.exposure)} EV`;
  }

  draw() {
    const canvas = this.canvas, ratio = devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !this.isPainted()) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = canvas.getContext('2d');
    const zoom = this.zoom ?? this.fit();
    const clamp = (v, size, room) => {
      const half = room / zoom / 2;
      return half >= size / 2 ? size / 2 : Math.min(Math.max(v, half), size - half);
    };
    this.centre = [clamp(this.centre[0], this.width, width), clamp(this.centre[1], this.height, height)];
    context.imageSmoothingEnabled = zoom * ratio < 1;
    context.imageSmoothingQuality = 'high';
    this.drawImages(context, (image) => context.drawImage(image, canvas.width / 2 - this.centre[0] * zoom * ratio,
      canvas.height / 2 - this.centre[1] * zoom * ratio, this.width * zoom * ratio, this.height * zoom * ratio));
    this.stage.classList.toggle('zoomed', this.zoom !== null && this.zoom > this.fit() * 1.001);
    this.percent.textContent = `${Number((zoom * ratio * 100).toPrecision(3))} %`;
  }

  // Returns the index of the pixel at an event, and its coordinates; null outside of the image.
  pixelAt(event) {
    const [x, y] = this.imagePoint(event, this.zoom ?? this.fit()).map(Math.floor);
    return x < 0 || y < 0 || x >= this.width || y >= this.height ? null : [y * this.width + x, x, y];
  }

  read(lines) {
    this.readout.replaceChildren(...lines.map((line) => Object.assign(document.createElement('span'), { textContent: line })));
  }
}
