// The page's behaviour: a picture and a task go to POST /predict, and what comes back is drawn over the picture.
"use strict";

const SIDES = ["left", "right"];
const CLASSES = { left: "Left hand", right: "Right hand", both_same: "Both, one thing", both_different: "Both, two things" };
const DRAWN_PX = 1100;         // the longer side of the canvas, at least
const MAX_BYTES = 16 * 1024 * 1024;
const FILL = 105;              // opacity of a region, of 255

const $ = (id) => document.getElementById(id);
const shown = { file: null, image: null, answer: null, maps: null, ways: {}, visible: {}, threshold: 0.5, asked: 0 };

function make(tag, attributes = {}, ...children) {
  const node = Object.assign(document.createElement(tag), attributes);
  node.append(...children);
  return node;
}

// The colour of a hand, [red, green, blue], as the style sheet has it.
function colour(side) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${side}`).match(/\d+/g).map(Number);
}

function say(state, words) {
  $("main").dataset.state = state;
  $("status").textContent = words;
}

function fail(words) {
  $("error").textContent = words;
  $("error").hidden = false;
  say("error", "");
}

// -- the picture -----------------------------------------------------------------------------------------------------

async function take(file) {
  $("error").hidden = true;
  if (file.size > MAX_BYTES) return fail(`${file.name}: expected an image of at most 16 MiB, got ${(file.size / 2 ** 20).toFixed(1)} MiB; make it smaller.`);
  let image;
  try {
    image = await createImageBitmap(file);
  } catch {
    return fail(`${file.name}: expected an image (JPEG, PNG or WebP), got a file that cannot be shown as one; choose another.`);
  }
  Object.assign(shown, { file, image, answer: null, maps: null });
  $("answer").hidden = $("unknown").hidden = $("read-as").hidden = true;
  $("invitation").hidden = true;
  $("canvas").hidden = $("under").hidden = false;
  $("drop").classList.add("full");
  $("size").textContent = `${file.name}, ${image.width} × ${image.height}`;
  $("canvas").setAttribute("aria-label", `The picture ${file.name}`);
  draw();
  if ($("task").value.trim()) return ask();
  say("ready", "Now say what is to be done.");
  $("task").focus();
}

// -- the question ----------------------------------------------------------------------------------------------------

async function ask() {
  const task = $("task").value.trim();
  $("error").hidden = true;
  if (!shown.image) return fail("Choose a picture first.");
  if (!task) return fail("Say what is to be done, for example: pour tea from kettle.");
  const mine = ++shown.asked;
  const hands = new FormData($("question")).get("hands");
  say("busy", "Asking the model …");
  let answer, maps;
  try {
    const reply = await fetch(`/predict?${new URLSearchParams({ task, hands })}`, { method: "POST", body: shown.file });
    answer = await reply.json();
    if (!reply.ok) throw new Error(answer.error);
    maps = await readMaps(answer);
  } catch (error) {
    if (mine === shown.asked) fail(error instanceof TypeError ? "The server does not answer; is it still running?" : error.message);
    return;
  }
  if (mine !== shown.asked) return;
  Object.assign(shown, { answer, maps, threshold: shown.touched ? shown.threshold : answer.threshold });
  for (const side of SIDES) {
    shown.ways[side] = answer[side].best;
    shown.visible[side] = answer[side].selected;
  }
  describe();
  draw();
  say("done", "");
}

async function readMaps(answer) {
  const maps = {};
  for (const side of SIDES) maps[side] = await Promise.all(answer.maps[side].map(readMap));
  return maps;
}

async function readMap(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  return createImageBitmap(new Blob([bytes], { type: "image/png" }));
}

// -- the drawing -----------------------------------------------------------------------------------------------------

function draw() {
  const { image } = shown, canvas = $("canvas"), scale = Math.max(1, DRAWN_PX / Math.max(image.width, image.height));
  const shrink = Math.min(1, 2 * DRAWN_PX / Math.max(image.width, image.height));
  canvas.width = Math.round(image.width * scale * shrink);
  canvas.height = Math.round(image.height * scale * shrink);
  const context = canvas.getContext("2d");
  context.imageSmoothingQuality = "high";
  context.drawImage(image, 0, 0, canvas.width, canvas.height);
  if (!shown.maps) return;
  for (const side of SIDES) {
    if (shown.visible[side]) context.drawImage(region(shown.maps[side][shown.ways[side]], canvas.width, canvas.height, colour(side)), 0, 0);
  }
}

// A transparent picture of one region: tinted where the probability is above the threshold, with an outline in white and colour.
function region(map, width, height, [red, green, blue]) {
  const layer = new OffscreenCanvas(width, height), context = layer.getContext("2d", { willReadFrequently: true });
  context.imageSmoothingQuality = "high";
  context.drawImage(map, 0, 0, width, height);
  const pixels = context.getImageData(0, 0, width, height), data = pixels.data, least = shown.threshold * 255;
  const inside = new Uint8Array(width * height);
  for (let n = 0; n < inside.length; n++) inside[n] = data[4 * n] > least ? 1 : 0;
  data.fill(0);
  const thick = Math.max(2, Math.round(Math.max(width, height) / 500));
  for (let y = 0, n = 0; y < height; y++) {
    for (let x = 0; x < width; x++, n++) {
      const here = inside[n];
      const edge = differs(inside, n, x, y, width, height, thick, here);
      if (!here && !edge) continue;
      data.set(here ? [red, green, blue, edge ? 255 : FILL] : [255, 255, 255, 230], 4 * n);
    }
  }
  context.putImageData(pixels, 0, 0);
  return layer;
}

function differs(inside, n, x, y, width, height, thick, here) {
  return (x >= thick && inside[n - thick] !== here) || (x < width - thick && inside[n + thick] !== here)
      || (y >= thick && inside[n - thick * width] !== here) || (y < height - thick && inside[n + thick * width] !== here);
}

// -- the words -------------------------------------------------------------------------------------------------------

const percent = (value) => `${Math.round(100 * value)}\u00a0%`;

function bar(value) {
  const fill = make("i");
  fill.style.width = `${100 * value}%`;
  return make("span", { className: "bar" }, fill);
}

function describe() {
  const { answer } = shown;
  $("answer").hidden = false;
  $("hands").replaceChildren(...SIDES.map(card));
  const unknown = answer.unknown_words ?? [];
  const readAs = Object.entries(answer.read_as ?? {}).map(([word, other]) => `“${word}” as “${other}”`);
  $("read-as").hidden = !readAs.length;
  $("read-as").textContent = `Read ${readAs.join(", ")}: words of the training that stand in.`;
  const quoted = (words) => words.map((word) => `“${word}”`).join(", ");
  const lookedFor = answer.looked_for ?? [], strange = unknown.filter((word) => !lookedFor.includes(word));
  const sentences = [
    lookedFor.length && `The training did not contain ${quoted(lookedFor)}, which the classifier of the image encoder looks for.`,
    answer.present < 0.5 && `What the task names may not be in the picture (${percent(answer.present)})${shown.threshold >= 1 ? ", so that no region is shown. Lower the threshold to see where the model would act." : "."}`,
    strange.length && `The training of this model did not contain ${quoted(strange)}, so that the answer goes by the other words and the picture. The known words are below.`,
  ];
  $("unknown").textContent = sentences.filter(Boolean).join(" ");
  $("unknown").hidden = !$("unknown").textContent;
  $("pairs").hidden = !(answer.left.selected && answer.right.selected);
  $("taxonomy").replaceChildren(...Object.entries(answer.taxonomy.probabilities).flatMap(([name, value]) => {
    const className = name === answer.taxonomy.label ? "likeliest" : "";
    return [make("dt", { className, textContent: CLASSES[name] }), make("dd", {}, bar(value)), make("dd", { className: `number ${className}`, textContent: percent(value) })];
  }));
  $("threshold").value = shown.threshold;
  $("threshold-said").textContent = shown.threshold.toFixed(2);
  $("time").textContent = `Answered in ${answer.timing_ms.wall.toFixed(0)} ms (${answer.timing_ms.cpu.toFixed(0)} ms of CPU).`;
  label();
}

function card(side) {
  const hand = shown.answer[side];
  const toggle = make("input", { type: "checkbox", checked: shown.visible[side], id: `show-${side}`, disabled: !hand.selected });
  toggle.addEventListener("change", () => { shown.visible[side] = toggle.checked; draw(); label(); });
  const name = make("label", { htmlFor: toggle.id }, toggle, side === "left" ? "Left hand" : "Right hand");
  const note = make("span", { className: "faint", id: `area-${side}`, textContent: hand.selected ? area(side) : "not needed" });
  const node = make("div", { className: `hand ${side}${hand.selected ? "" : " idle"}` }, make("header", {}, name, note));
  if (hand.selected && hand.hypotheses.length > 1) node.append(ways(side, hand));
  if (hand.selected) {
    const button = make("button", { type: "button", className: "plain", id: `save-${side}`, textContent: "Download the mask" });
    button.setAttribute("aria-label", `Download the mask of the ${side} hand`);
    button.addEventListener("click", () => save(side));
    node.append(button);
  }
  return node;
}

function ways(side, hand) {
  const group = make("div", { className: "ways" });
  group.setAttribute("role", "radiogroup");
  group.setAttribute("aria-label", `Regions of the ${side} hand`);
  const order = hand.hypotheses.map((_, n) => n).sort((a, b) => hand.hypotheses[b].score - hand.hypotheses[a].score);
  order.forEach((n, rank) => {
    const radio = make("input", { type: "radio", name: `way-${side}`, value: n, checked: n === shown.ways[side] });
    radio.addEventListener("change", () => choose(side, n));
    group.append(make("label", {}, radio, `Region ${rank + 1}`, bar(hand.hypotheses[n].score), make("span", { className: "number", textContent: percent(hand.hypotheses[n].score) })));
  });
  return group;
}

function choose(side, n) {
  const together = shown.answer.left.selected && shown.answer.right.selected;
  for (const each of together ? SIDES : [side]) {
    shown.ways[each] = n;
    for (const radio of document.getElementsByName(`way-${each}`)) radio.checked = Number(radio.value) === n;
  }
  refresh();
}

function refresh() {
  draw();
  for (const side of SIDES) if (shown.answer[side].selected) $(`area-${side}`).textContent = area(side);
  label();
}

// The region that is shown, at the picture's own size: a PNG, white inside and black outside.
async function save(side) {
  const { width, height } = shown.image, layer = new OffscreenCanvas(width, height), context = layer.getContext("2d");
  context.imageSmoothingQuality = "high";
  context.drawImage(shown.maps[side][shown.ways[side]], 0, 0, width, height);
  const pixels = context.getImageData(0, 0, width, height), { data } = pixels, least = shown.threshold * 255;
  for (let n = 0; n < data.length; n += 4) data.fill(data[n] > least ? 255 : 0, n, n + 3);
  context.putImageData(pixels, 0, 0);
  const url = URL.createObjectURL(await layer.convertToBlob({ type: "image/png" }));
  make("a", { href: url, download: `${shown.file.name.replace(/\.[^.]*$/, "")}_${side}.png` }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

const measured = new WeakMap();   // map -> Uint8 histogram of its probabilities, so that the slider is quick

function area(side) {
  const map = shown.maps[side][shown.ways[side]];
  if (!measured.has(map)) {
    const context = new OffscreenCanvas(map.width, map.height).getContext("2d");
    context.drawImage(map, 0, 0);
    const counts = new Float64Array(256), { data } = context.getImageData(0, 0, map.width, map.height);
    for (let n = 0; n < data.length; n += 4) counts[data[n]] += 4 / data.length;
    measured.set(map, counts);
  }
  const share = measured.get(map).reduce((sum, count, value) => sum + (value > shown.threshold * 255 ? count : 0), 0);
  return share ? `${(100 * share).toFixed(1)} % of the picture` : "none at this threshold";
}

function label() {
  const seen = SIDES.filter((side) => shown.visible[side]).map((side) => `${side} hand, ${area(side)}`);
  $("canvas").setAttribute("aria-label", `The picture with regions for: ${seen.join("; ") || "no hand"}`);
}

// -- events ----------------------------------------------------------------------------------------------------------

$("file").addEventListener("change", () => { if ($("file").files.length) take($("file").files[0]); $("file").value = ""; });
$("another").addEventListener("click", () => $("file").click());
$("drop").addEventListener("click", (event) => { if (shown.image) event.preventDefault(); });
$("question").addEventListener("submit", (event) => { event.preventDefault(); ask(); });
for (const radio of document.getElementsByName("hands")) radio.addEventListener("change", () => { if (shown.image && $("task").value.trim()) ask(); });
$("threshold").addEventListener("input", () => {
  shown.touched = true;
  shown.threshold = Number($("threshold").value);
  $("threshold-said").textContent = shown.threshold.toFixed(2);
  refresh();
});
for (const kind of ["dragenter", "dragover"]) document.addEventListener(kind, (event) => { event.preventDefault(); $("drop").classList.add("over"); });
document.addEventListener("dragleave", (event) => { if (!event.relatedTarget) $("drop").classList.remove("over"); });
document.addEventListener("drop", (event) => {
  event.preventDefault();
  $("drop").classList.remove("over");
  if (event.dataTransfer.files.length) take(event.dataTransfer.files[0]);
});
document.addEventListener("paste", (event) => { if (event.clipboardData.files.length) take(event.clipboardData.files[0]); });

async function start() {
  const model = await (await fetch("/model.json")).json();
  $("model").textContent = `model ${model.name}, ${model.digest.slice(0, 12)}`;
  if (model.words) {
    for (const kind of ["verbs", "things"]) $(kind).textContent = model.words[kind].join(", ");
    $("words").querySelector("dl").hidden = false;
    $("words").querySelector("p").hidden = true;
  }
  const examples = await (await fetch("/examples.json")).json();
  $("examples").hidden = !examples.length;
  $("examples").querySelector("ul").replaceChildren(...examples.map(({ url, task }) => {
    const button = make("button", { type: "button" }, make("img", { src: url, alt: "", loading: "lazy" }), make("span", { textContent: task }));
    button.addEventListener("click", async () => {
      $("task").value = task;
      take(new File([await (await fetch(url)).blob()], url.split("/").pop(), { type: "image/jpeg" }));
    });
    return make("li", {}, button);
  }));
}

start().catch(() => fail("The server does not answer; is it still running?"));
