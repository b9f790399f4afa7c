// The pointer over the patch: mouse, pen or finger.

// The event of a move. Raw updates come without waiting for the next frame, where there are any.
const MOVES = "onpointerrawupdate" in globalThis ? "pointerrawupdate" : "pointermove";

class Pointer {
  // Calls `onbegin`, `onmove` and `onend` when the pointer touches `element`, the patch, moves and lifts, and
  // `onwheel(steps)` when a wheel turns.
  constructor(element, { onbegin, onmove, onend, onwheel }) {
    this.element = element;
    this.path = new PointerPath();
    this.id = null;
    this.pressure = null;
    this.stamp = null;
    element.addEventListener("pointerdown", (event) => {
      if (this.id !== null || event.button > 0) return;
      this.id = event.pointerId;
      element.setPointerCapture(event.pointerId);
      this.path.begin();
      this.take(event);
      onbegin();
    });
    element.addEventListener(MOVES, (event) => {
      if (event.pointerId !== this.id) return;
      const events = event.getCoalescedEvents?.() ?? [];
      for (const one of events.length > 0 ? events : [event]) this.take(one);
      onmove();
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      element.addEventListener(end, (event) => {
        if (event.pointerId !== this.id) return;
        this.lift();
        onend();
      });
    }
    element.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        onwheel(-Math.sign(event.deltaY));
      },
      { passive: false },
    );
    // A finger that rests does not open a menu.
    element.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  take(event) {
    this.box ??= this.element.getBoundingClientRect();
    this.path.add(event.timeStamp, event.clientX, event.clientY);
    this.x = clampShare((event.clientX - this.box.left) / this.box.width);
    this.y = clampShare((event.clientY - this.box.top) / this.box.height);
    this.stamp = event.timeStamp;
    // A mouse, and a finger on most screens, say 0.5 or 1 whatever they do.
    const isTelling = event.pointerType === "touch" && ![0, 0.5, 1].includes(event.pressure);
    const tells = event.pointerType === "pen" || isTelling;
    this.pressure = tells ? event.pressure : null;
  }

  lift() {
    this.id = null;
    this.pressure = null;
    this.box = null;
  }

  get touches() {
    return this.id !== null;
  }
}

function clampShare(share) {
  return Math.max(0, Math.min(1, share));
}
