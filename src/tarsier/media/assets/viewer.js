"use strict";
const image = document.getElementById("image");
const state = document.getElementById("state");
const stream = image.getAttribute("src");
let connected = true;
async function look() {
  try {
    const health = await (await fetch("healthz" + location.search, {cache: "no-store"})).json();
    if (!connected) image.src = stream + (stream.includes("?") ? "&" : "?") + "again=" + Date.now();
    connected = true;
    state.textContent = health.state + " \u00b7 " + health.frames + " frames \u00b7 " + health.viewers + " viewers";
  } catch (error) {
    connected = false;
    state.textContent = "not connected";
  }
}
image.addEventListener("error", () => { connected = false; });
setInterval(look, 2000);
look();
