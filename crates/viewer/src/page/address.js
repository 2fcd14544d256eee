// URL fragment: holds the state of the page, so that a reload or a copied address restores it. The
// token is moved from the fragment into the session storage of the tab.

/** Milliseconds from a change to its write into the URL; browsers limit the rate of writes. */
const WRITE_DELAY = 400;
const TOKEN_KEY = "specula-token";

const parameters = new URLSearchParams(location.hash.slice(1));

/** Access token: from the fragment, else from the session storage. */
export const token = takeToken();

function takeToken() {
  const given = parameters.get("token");
  try {
    if (given !== null) sessionStorage.setItem(TOKEN_KEY, given);
    const stored = sessionStorage.getItem(TOKEN_KEY) ?? "";
    parameters.delete("token");
    replaceFragment(parameters);
    return stored;
  } catch {
    // Without session storage the token stays in the fragment.
    return given ?? "";
  }
}

function replaceFragment(parameters) {
  // Commas need no escape in a fragment and are easier to read without.
  const text = decodeURIComponent(parameters.toString());
  if (`#${text}` !== location.hash) history.replaceState(null, "", text === "" ? location.pathname + location.search : `#${text}`);
}

/** Parameters of the fragment at page load, by name. */
export const initial = Object.fromEntries(parameters);

/** Parses a list of `count` finite numbers separated by commas; null where the text is none. */
export function numbers(text, count) {
  const list = (text ?? "").split(",").map(Number);
  return text && list.length === count && list.every(Number.isFinite) ? list : null;
}

/** Writes the state of the page into the fragment, debounced. */
export class Address {
  /** `state` returns the parameters to write. */
  constructor(state) {
    this.state = state;
    // A fragment edited by hand takes effect on a reload.
    window.addEventListener("hashchange", () => location.reload());
  }

  changed() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.write(), WRITE_DELAY);
  }

  write() {
    const parameters = new URLSearchParams();
    const token = new URLSearchParams(location.hash.slice(1)).get("token");
    if (token !== null) parameters.set("token", token);
    for (const [name, value] of Object.entries(this.state())) parameters.set(name, value);
    replaceFragment(parameters);
  }
}
