"use strict";
// A tap on a tile's picture strikes its object.
const player = new Audio();
for (const button of document.querySelectorAll("[data-sound]")) {
  button.addEventListener("click", () => {
    player.src = button.dataset.sound;
    player.play();
  });
}
