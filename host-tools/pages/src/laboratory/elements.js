// Elements of the page. Names of files and textures become texts and values alone, never markup.

const byId = (id) => document.getElementById(id);

// An element with these properties (`aria-…` and `data-…` as attributes) and children.
function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.includes("-")) made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children);
  return made;
}

function show(id, text) {
  byId(id).textContent = text;
  byId(id).hidden = !text;
}

function saveFile(name, blob) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const megabytes = (bytes) => `${(bytes / 1e6).toFixed(1)} MB`;
const countOf = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;
