// The fragment of the address: what is shown, so that a reload shows it again and a copied address shows it to others. The
// token is taken out of it, and kept for this tab alone.

/** Milliseconds after a change until the address says so; browsers allow a few in a second. */
const PAUSE = 400;
const TOKEN = "specula-token";

const words = new URLSearchParams(location.hash.slice(1));

/** The token of this page: that of the address, else the one that was kept when this tab was loaded before. */
export const token = takeToken();

function takeToken() {
  const given = words.get("token");
  try {
    if (given !== null) sessionStorage.setItem(TOKEN, given);
    const kept = sessionStorage.getItem(TOKEN) ?? "";
    words.delete("token");
    replace(words);
    return kept;
  } catch {
    // Where nothing may be kept, the token stays in the address.
    return given ?? "";
  }
}

function replace(words) {
  // Commas and the like need no escape there, and are easier to read without.
  const text = decodeURIComponent(words.toString());
  if (`#${text}` !== location.hash) history.replaceState(null, "", text === "" ? location.pathname : `#${text}`);
}

/** What the address asked for when the page was loaded, by name. */
export const asked = Object.fromEntries(words);

/** A list of so many numbers; none where it is something else. */
export function numbers(text, count) {
  const list = (text ?? "").split(",").map(Number);
  return text && list.length === count && list.every(Number.isFinite) ? list : null;
}

/** Writes what is shown into the address, when it has not changed for a moment. */
export class Address {
  constructor(state) {
    this.state = state;
    // Somebody who changes the fragment by hand wants to see what it says.
    window.addEventListener("hashchange", () => location.reload());
  }

  changed() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.write(), PAUSE);
  }

  write() {
    const words = new URLSearchParams();
    const kept = new URLSearchParams(location.hash.slice(1)).get("token");
    if (kept !== null) words.set("token", kept);
    for (const [name, value] of Object.entries(this.state())) words.set(name, value);
    replace(words);
  }
}
