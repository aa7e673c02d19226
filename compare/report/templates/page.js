
"use strict";
const LONG = 8;  // tables with more rows have a filter

function sortable(table) {
  const body = table.tBodies[0], made = [...body.rows], heads = [...table.tHead.rows[0].cells];
  const next = {none: "ascending", ascending: "descending", descending: "none"};
  const words = new Intl.Collator("en", {numeric: true});
  heads.forEach((head, column) => {
    const number = head.classList.contains("number");
    const key = row => {
      const cell = row.cells[column];
      if (!number) return cell.textContent;
      return "value" in cell.dataset ? Number(cell.dataset.value) : null;
    };
    const button = document.createElement("button");
    button.type = "button";
    button.title = "Sort";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const order = next[head.getAttribute("aria-sort") ?? "none"];
      const sign = order === "descending" ? -1 : 1;
      heads.forEach(other => other.removeAttribute("aria-sort"));
      if (order === "none") return body.append(...made);
      head.setAttribute("aria-sort", order);
      body.append(...made.map(row => [key(row), row]).sort(([a], [b]) => {
        if (a === null || b === null) return (a === null) - (b === null);  // cells without a number are sorted last
        return sign * (number ? a - b : words.compare(a, b));
      }).map(([, row]) => row));
    });
  });
}

function filterable(table) {
  const rows = [...table.tBodies[0].rows];
  if (rows.length <= LONG) return;
  const bar = document.createElement("label"), input = document.createElement("input");
  const count = document.createElement("span");
  bar.className = "filter";
  input.type = "search";
  input.placeholder = "words in a row";
  count.setAttribute("aria-live", "polite");
  bar.append("Filter", input, count);
  table.parentElement.before(bar);
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) {
      const text = [...row.cells].map(cell => cell.textContent.toLowerCase()).join(" ");
      row.hidden = !words.every(word => text.includes(word));
    }
    const left = rows.filter(row => !row.hidden).length;
    count.textContent = !words.length ? "" : left ? `${left} of ${rows.length} rows` :
      `No row of ${rows.length} has ${words.length > 1 ? "all these words" : "this word"}.`;
  });
}

const dialog = document.querySelector("dialog"), enlarged = dialog.querySelector("img");

function enlargeable(image) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "enlarge";
  button.title = "Enlarge";
  image.replaceWith(button);
  button.append(image);
  button.addEventListener("click", () => {
    enlarged.src = image.src;
    enlarged.alt = image.alt;
    dialog.showModal();
  });
}

document.querySelectorAll("table.data").forEach(sortable);
document.querySelectorAll("table.data").forEach(filterable);
document.querySelectorAll("figure img").forEach(enlargeable);
enlarged.addEventListener("click", () => dialog.close());

let opened = [];
addEventListener("beforeprint", () => {
  opened = [...document.querySelectorAll("details:not([open], .long)")];
  opened.forEach(details => { details.open = true; });
});
addEventListener("afterprint", () => opened.forEach(details => { details.open = false; }));
