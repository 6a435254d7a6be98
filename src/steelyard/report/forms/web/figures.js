// Draws the pictures of the page when they come into view, in the colours that the style sheet has for the scheme.
"use strict";

const NARROW = 700; // [px], of a picture that has another layout below
const PAPER_WIDTH = 660; // [px], of a page of A4 within its margins
const root = document.documentElement;
const darkness = matchMedia("(prefers-color-scheme: dark)");
const PAPER_HEIGHT = 0.72; // of that on a screen
const drawn = new Map(); // plot -> what it was drawn from

function colour(name) {
  return getComputedStyle(root).getPropertyValue(`--${name}`).trim();
}

// Colours that are names of the style sheet, `var(--good)`, as it has them now.
function dressed(value, key = "") {
  if (typeof value === "string") {
    const name = /colou?r/i.test(key) && /^var\(--([a-z0-9-]+)\)$/.exec(value);
    return name ? colour(name[1]) : value;
  }
  if (Array.isArray(value)) return value.map((each) => dressed(each, key));
  if (value !== null && typeof value === "object") return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, dressed(v, k)]));
  return value;
}

// Long arrays are beside the figure, once each.
function whole(value, arrays) {
  if (Array.isArray(value)) return value.map((each) => whole(each, arrays));
  if (value === null || typeof value !== "object") return value;
  if ("$" in value) return arrays[value.$];
  return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, whole(v, arrays)]));
}

// What all pictures have in common, as a template for Plotly.
function look() {
  const ink = colour("ink"), muted = colour("muted"), edge = colour("edge"), ground = colour("ground");
  const clear = "rgba(0,0,0,0)";
  const axis = {
    color: muted, gridcolor: edge, linecolor: muted, zerolinecolor: muted, zerolinewidth: 1, tickcolor: muted, ticks: "outside", ticklen: 4,
    showline: true, automargin: true, title: { standoff: 8, font: { color: ink } },
  };
  const wall = { color: muted, gridcolor: edge, linecolor: muted, zerolinecolor: edge, showbackground: false, showspikes: false, title: { font: { color: ink } } };
  const tones = { autocolorscale: true };
  return {
    data: { heatmap: [tones], contour: [tones], surface: [tones] },
    layout: {
      font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: ink },
      paper_bgcolor: clear, plot_bgcolor: clear, colorway: [1, 2, 3, 4, 5, 6, 7, 8].map((k) => colour(`line-${k}`)),
      margin: { l: 56, r: 12, t: 30, b: 44 }, xaxis: axis, yaxis: axis, hovermode: "closest", dragmode: "zoom",
      legend: { orientation: "h", x: 0, xanchor: "left", yref: "container", y: 0, yanchor: "bottom", font: { color: ink } },
      hoverlabel: { bgcolor: ground, bordercolor: muted, font: { color: ink }, namelength: -1 },
      colorscale: { diverging: [[0, colour("line-1")], [0.5, ground], [1, colour("line-2")]], sequential: "Viridis", sequentialminus: "Viridis" },
      modebar: { bgcolor: clear, color: muted, activecolor: ink },
      annotationdefaults: { font: { color: ink }, arrowcolor: muted },
      shapedefaults: { line: { color: muted } },
      scene: { xaxis: wall, yaxis: wall, zaxis: wall, aspectmode: "data", dragmode: "turntable" },
    },
  };
}

function draw(plot) {
  let state = drawn.get(plot);
  const first = !state;
  if (first) {
    const written = JSON.parse(document.getElementById(`${plot.id}-data`).textContent);
    const figure = whole(written, written.arrays);
    state = { figure, height: plot.clientHeight, scene: plot.parentElement.classList.contains("scene") ? new Scene(plot, figure) : null };
    drawn.set(plot, state);
  }
  const { figure, scene } = state;
  const printing = root.classList.contains("printing");
  let data = dressed(figure.data);
  state.narrow = !printing && plot.clientWidth < NARROW;
  const narrow = state.narrow && figure.narrow;
  const height = narrow ? figure.narrow.height : state.height;
  plot.style.height = `${printing && !scene ? Math.round(PAPER_HEIGHT * height) : height}px`;
  const own = narrow ? figure.narrow.layout : figure.layout;
  let layout = { ...dressed(own), template: look(), uirevision: "kept", height: plot.clientHeight, autosize: !printing };
  if (printing) layout.width = PAPER_WIDTH;
  if (scene) {
    layout.margin = { l: 0, r: 0, t: 30, b: 0, ...layout.margin };
    [data, layout] = scene.place(data, layout);
  }
  const config = {
    displaylogo: false, responsive: true, scrollZoom: false, toImageButtonOptions: { filename: plot.id },
    modeBarButtons: [scene ? ["toImage"] : ["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };
  const done = first ? Plotly.newPlot(plot, data, layout, config) : Plotly.react(plot, data, layout, config);
  return done.then(() => {
    if (first) {
      describe(plot);
      if (scene) scene.connect();
    }
    if (scene && printing) scene.copy();
    plot.querySelectorAll(".modebar-btn").forEach((button) => button.setAttribute("aria-label", button.dataset.title));
    plot.dataset.drawn = darkness.matches && !printing ? "dark" : "light";
  });
}

// The picture itself is what the text stands for; the buttons that Plotly puts beside it are none of it.
function describe(plot) {
  const [picture, ...others] = plot.querySelectorAll(".main-svg");
  picture.setAttribute("role", "img");
  picture.setAttribute("aria-label", plot.getAttribute("aria-label"));
  others.forEach((other) => other.setAttribute("aria-hidden", "true"));
  plot.setAttribute("role", "group");
}

function redraw() {
  drawn.forEach((_, plot) => {
    if (plot.clientWidth) draw(plot);
    else {
      // What is not seen now is drawn when it is, in the colours of then.
      Plotly.purge(plot);
      drawn.delete(plot);
      watch.observe(plot);
    }
  });
}

// One run at a time: what is chosen in one place holds wherever there is something of that run.
function choose(name) {
  document.querySelectorAll(".choice").forEach((choice) => {
    const options = [...choice.querySelectorAll(":scope > .option")];
    const chosen = options.find((option) => option.dataset.option === name);
    if (!chosen) return;
    options.forEach((option) => { option.hidden = option !== chosen; });
    choice.querySelector(":scope > .chooser select").value = name;
  });
}

document.querySelectorAll(".choice").forEach((choice) => {
  const options = choice.querySelectorAll(":scope > .option");
  const chooser = choice.querySelector(":scope > .chooser");
  options.forEach((option, i) => { option.hidden = i > 0; });
  chooser.hidden = options.length < 2;
  chooser.querySelector("select").addEventListener("change", (event) => {
    const before = choice.getBoundingClientRect().top;
    choose(event.target.value);
    // Others above may be longer or shorter now: this one stays where it is looked at.
    scrollBy(0, choice.getBoundingClientRect().top - before);
  });
});

const plots = document.querySelectorAll(".plot");
const watch = new IntersectionObserver(
  (entries) => entries.filter((entry) => entry.isIntersecting).forEach(({ target }) => { watch.unobserve(target); draw(target); }),
  { rootMargin: "400px" },
);
plots.forEach((plot) => watch.observe(plot));
darkness.addEventListener("change", redraw);
addEventListener("resize", () => drawn.forEach((state, plot) => {
  if (state.figure.narrow && plot.clientWidth && state.narrow !== plot.clientWidth < NARROW) draw(plot);
}));
addEventListener("beforeprint", () => {
  root.classList.add("printing");
  plots.forEach((plot) => {
    if (!plot.clientWidth) return; // of another run, or folded away
    watch.unobserve(plot);
    draw(plot);
  });
});
addEventListener("afterprint", () => {
  root.classList.remove("printing");
  redraw();
});
