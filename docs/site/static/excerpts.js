// Answer requests of the search for pages from TEXTS, because pages opened as files have no others.
const requested = window.fetch;
window.fetch = (address, ...options) => {
  const root = new URL(document.documentElement.dataset.content_root, location.href).href;
  const page = new URL(address, location.href).href.split("#")[0].replace(root, "");
  if (!(page in TEXTS)) return requested(address, ...options);
  return Promise.resolve(new Response(`<div role="main">${TEXTS[page]}</div>`));
};
