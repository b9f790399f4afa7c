// The patch: its surface, the tool on it, and where that was.

// Colours of surfaces along a scene's path.
const SURFACE_COLOURS = ["--blue", "--orange", "--green", "--purple", "--sky", "--vermilion"];

// Places that the trail keeps.
const TRAIL = 40;

class Patch {
  constructor(element, canvas) {
    this.element = element;
    this.canvas = canvas;
    this.trail = [];
    this.relief = null;
    this.bands = [];
    this.tool = null;
    this.isStill = matchMedia("(prefers-reduced-motion: reduce)");
    new ResizeObserver(() => this.resize()).observe(element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  get width() {
    return this.element.clientWidth;
  }

  resize() {
    const ratio = Math.min(2, globalThis.devicePixelRatio || 1);
    this.canvas.width = Math.round(this.element.clientWidth * ratio);
    this.canvas.height = Math.round(this.element.clientHeight * ratio);
    this.onresize?.();
    this.draw();
  }

  // Shows `relief`, accelerations along the path over twice their RMS, or none yet, over bands of colours. What is
  // fixed to the surface, as threads and scratches are, runs across it; noise does not.
  show(relief, bands, runsAcross) {
    this.relief = relief;
    this.bands = bands;
    this.runsAcross = runsAcross;
    this.trail = [];
    this.draw();
  }

  // Moves the tool to shares of the patch, or lifts it.
  move(x, y, touches) {
    this.tool = { x, y, touches };
    if (touches && !this.isStill.matches) {
      this.trail.push({ x, y });
      if (this.trail.length > TRAIL) this.trail.shift();
    } else if (this.trail.length > 0) {
      this.trail.shift();
    }
    this.draw();
  }

  draw() {
    const { canvas } = this;
    const context = canvas.getContext("2d");
    const style = getComputedStyle(this.element);
    const colour = (name) => style.getPropertyValue(name).trim();
    const { width, height } = canvas;
    context.clearRect(0, 0, width, height);
    this.drawBands(context, colour);
    this.drawRelief(context, colour("--ink"));
    context.lineCap = "round";
    context.lineWidth = height / 40;
    context.strokeStyle = colour("--warn-edge");
    for (let n = 1; n < this.trail.length; n++) {
      const [from, to] = [this.trail[n - 1], this.trail[n]];
      context.globalAlpha = (0.5 * n) / this.trail.length;
      context.beginPath();
      context.moveTo(from.x * width, from.y * height);
      context.lineTo(to.x * width, to.y * height);
      context.stroke();
    }
    context.globalAlpha = 1;
    if (this.tool) {
      const radius = Math.max(8, height / 26);
      context.beginPath();
      context.arc(this.tool.x * width, this.tool.y * height, radius, 0, 2 * Math.PI);
      context.fillStyle = this.tool.touches ? colour("--warn-edge") : "transparent";
      context.strokeStyle = this.tool.touches ? colour("--ground") : colour("--warn-edge");
      context.lineWidth = radius / 3;
      context.fill();
      context.stroke();
    }
  }

  drawBands(context, colour) {
    const { width, height } = this.canvas;
    for (const { from, to, surface } of this.bands) {
      context.globalAlpha = 0.22;
      context.fillStyle = colour(SURFACE_COLOURS[surface % SURFACE_COLOURS.length]);
      context.fillRect(from * width, 0, (to - from) * width, height);
    }
    context.globalAlpha = 1;
  }

  // Columns as dark as the texture's own acceleration along the path. Of noise, strips of it stand one below the other,
  // each shifted, as a grain.
  drawRelief(context, ink) {
    if (!this.relief) return;
    const { width, height } = this.canvas;
    const strips = this.runsAcross ? 1 : 24;
    context.fillStyle = ink;
    const step = Math.max(1, Math.round(width / 700));
    for (let strip = 0; strip < strips; strip++) {
      const shift = (strip * 7919) % this.relief.length;
      const [top, bottom] = [strip, strip + 1].map((edge) => Math.round((height * edge) / strips));
      for (let x = 0; x < width; x += step) {
        const level = this.relief[(Math.floor((x * this.relief.length) / width / 2) + shift) % this.relief.length];
        if (level > 0.02) {
          context.globalAlpha = Math.min(0.34, 0.3 * level);
          context.fillRect(x, top, step, bottom - top);
        }
      }
    }
    context.globalAlpha = 1;
  }
}
