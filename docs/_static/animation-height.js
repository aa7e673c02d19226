// An animation says how high it is when it has been drawn; its frame takes that height.
addEventListener("message", event => {
  const frame = document.querySelector("iframe.animation");
  if (event.source === frame?.contentWindow) frame.style.height = `${event.data.height + 2}px`;  // with its border
});
