/* Moves the border between the two pictures of a view with its slider. Without it, the border stays in the middle. */
"use strict";
for (const slider of document.querySelectorAll(".compare input")) {
  slider.addEventListener("input", () => slider.parentNode.style.setProperty("--at", slider.value + "%"));
}
