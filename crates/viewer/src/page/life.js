// Lifetime of the displayed scene: its window listeners end with it.

export const life = {
  controller: new AbortController(),

  /** Option of listeners that end with the scene. */
  get signal() {
    return this.controller.signal;
  },

  /** Ends the listeners. */
  renew() {
    this.controller.abort();
    this.controller = new AbortController();
  },
};
