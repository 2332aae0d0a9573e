/** The browser's side of photonbeams.studio.widget.Widget: it shows `picture`, and adds up movements in `gesture`. */

const RADIANS_PER_PIXEL = 0.006;
const RADIANS_PER_KEY = 0.06;
const NEARER_PER_PIXEL = 0.0012;
const NEARER_PER_KEY = 0.1;

/** Per key: radians to the left and up, and how much nearer. */
const KEYS = {
  ArrowLeft: [RADIANS_PER_KEY, 0, 0],
  ArrowRight: [-RADIANS_PER_KEY, 0, 0],
  ArrowUp: [0, RADIANS_PER_KEY, 0],
  ArrowDown: [0, -RADIANS_PER_KEY, 0],
  "+": [0, 0, NEARER_PER_KEY],
  "-": [0, 0, -NEARER_PER_KEY],
};

function element(name, properties = {}, children = []) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

function render({ model, el }) {
  const image = element("img", {
    alt: "The shot, rendered live",
    title: "Drag to orbit, with Shift to pan; after a click the wheel, + and − dolly, and arrow keys orbit",
    draggable: false,
    tabIndex: 0,
  });
  const problem = element("p");
  problem.setAttribute("role", "alert");
  const layer = element("select");
  const exposure = element("input", { type: "range", min: -8, max: 8, step: 0.1 });
  const stops = element("output");
  const home = element("button", { type: "button", textContent: "Stage’s camera" });
  const passes = element("output");
  const controls = element("div", {}, [
    element("label", {}, ["Layer", layer]),
    element("label", {}, ["Exposure", exposure, stops]),
    home,
    passes,
  ]);
  const root = element("div", { className: "photonbeams" }, [image, problem, controls]);
  // Keys are for the picture: JupyterLab must not take them as its shortcuts.
  root.dataset.lmSuppressShortcuts = "true";
  el.append(root);

  let url = null;
  const showPicture = () => {
    const { data, mime, whole, passes: done, planned } = model.get("picture");
    if (!data) return;
    const before = url;
    url = URL.createObjectURL(new Blob([data], { type: mime }));
    image.src = url;
    image.style.width = `${whole[0]}px`;
    image.style.aspectRatio = `${whole[0]} / ${whole[1]}`;
    passes.value = done === planned ? `${done} passes` : `${done} of ${planned} passes`;
    if (before) URL.revokeObjectURL(before);
  };
  const showProblem = () => {
    problem.textContent = model.get("problem");
  };
  const showLayers = () => {
    layer.replaceChildren(...model.get("layers").map((name) => element("option", { value: name, textContent: name })));
    layer.value = model.get("layer");
  };
  const showExposure = () => {
    const value = model.get("exposure");
    exposure.value = value;
    stops.value = `${value > 0 ? "+" : ""}${value.toFixed(1)}`;
  };

  const set = (name, value) => {
    model.set(name, value);
    model.save_changes(); // waits for the answer to the last change, and then sends only the newest
  };
  /** Add a movement: radians to the left and up, widths of the picture to the right and up, and nearer. */
  const move = (...more) => {
    const [homes, ...sums] = model.get("gesture");
    set("gesture", [homes, ...sums.map((sum, index) => sum + (more[index] ?? 0))]);
  };
  layer.onchange = () => set("layer", layer.value);
  exposure.oninput = () => set("exposure", Number(exposure.value));
  home.onclick = () => set("gesture", [model.get("gesture")[0] + 1, 0, 0, 0, 0, 0]);

  let last = null;
  image.onpointerdown = (event) => {
    if (event.button > 1) return;
    event.preventDefault();
    image.focus();
    image.setPointerCapture(event.pointerId);
    last = [event.clientX, event.clientY];
  };
  image.onpointermove = (event) => {
    if (!last) return;
    const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
    last = [event.clientX, event.clientY];
    if (event.shiftKey || event.buttons & 4) {
      const width = image.clientWidth || 1;
      move(0, 0, -dx / width, dy / width);
    } else {
      move(-dx * RADIANS_PER_PIXEL, -dy * RADIANS_PER_PIXEL);
    }
  };
  image.onpointerup = image.onpointercancel = () => {
    last = null;
  };
  const onWheel = (event) => {
    if (!image.matches(":focus")) return; // so that the notebook can be scrolled past the picture
    event.preventDefault();
    const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 16 : event.deltaY;
    move(0, 0, 0, 0, -NEARER_PER_PIXEL * Math.max(-200, Math.min(200, pixels)));
  };
  image.addEventListener("wheel", onWheel, { passive: false });
  image.onkeydown = (event) => {
    const key = KEYS[event.key === "=" ? "+" : event.key];
    if (!key || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    move(key[0], key[1], 0, 0, key[2]);
  };

  const watched = {
    "change:picture": showPicture,
    "change:problem": showProblem,
    "change:layers": showLayers,
    "change:layer": showLayers,
    "change:exposure": showExposure,
  };
  for (const [name, follow] of Object.entries(watched)) {
    model.on(name, follow);
    follow();
  }
  return () => {
    for (const [name, follow] of Object.entries(watched)) model.off(name, follow);
    if (url) URL.revokeObjectURL(url);
  };
}

export default { render };
