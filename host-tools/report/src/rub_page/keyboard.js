// Keys. Letters and digits count everywhere but in the search, arrows and the space bar only where no control wants
// them.

const KEY_ACTIONS = {
  ArrowLeft: { down: (page) => page.holdKey(-1), up: (page) => page.releaseKey(-1), isMoving: true },
  ArrowRight: { down: (page) => page.holdKey(1), up: (page) => page.releaseKey(1), isMoving: true },
  " ": { down: (page) => page.toggleStroke(), isMoving: true, isOnce: true },
  ArrowUp: { down: (page) => page.stepForce(1), isMoving: true },
  ArrowDown: { down: (page) => page.stepForce(-1), isMoving: true },
  "+": { down: (page) => page.stepSpeed(1) },
  "=": { down: (page) => page.stepSpeed(1) },
  "-": { down: (page) => page.stepSpeed(-1) },
  "−": { down: (page) => page.stepSpeed(-1) },
  c: { down: (page) => page.compare(), isOnce: true },
  s: { down: (page, event) => page.stepSeed(event.shiftKey ? -1 : 1), isOnce: true },
  t: { down: (page) => page.toggleTake(), isOnce: true },
  m: { down: (page) => page.toggleMute(), isOnce: true },
};

function actionOf(event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const wantsKey = event.target.closest?.("input, button, select, summary, a, [role=region], .axes");
  const action = KEY_ACTIONS[key];
  return action && !(action.isMoving && wantsKey) ? action : null;
}

function listenToKeys(page) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.type === "search") return;
    if (/^[1-9]$/.test(event.key)) {
      page.chooseShown(Number(event.key) - 1);
      return;
    }
    const action = actionOf(event);
    if (!action) return;
    event.preventDefault();
    if (!(event.repeat && (action.isOnce || action.up))) action.down(page, event);
  });
  document.addEventListener("keyup", (event) => KEY_ACTIONS[event.key]?.up?.(page));
}
