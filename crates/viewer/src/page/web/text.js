// Bytes of the text of a page's element: twenty bytes are 23 digits to the base 125.

/** Letters of a block, and the words of 32 bits that they become. */
const LETTERS = 23;
const WORDS = 5;
const BASE = 125;
const GROUP = BASE ** 3;
const WORD = 2 ** 32;
const PART = 2 ** -32;
/** Digit of each letter: ASCII from 1 on, without carriage return and `<`; 255 for others. */
const DIGITS = new Uint8Array(256).fill(255);
for (let letter = 1, digit = 0; letter < 128; letter++) {
  if (letter !== 13 && letter !== 60) DIGITS[letter] = digit++;
}

/** The `count` bytes of a text; throws an error if the text has another length or is damaged. */
export function bytesOf(text, count) {
  const letters = new TextEncoder().encode(text);
  const blocks = Math.ceil(count / (4 * WORDS));
  const refuse = () => new Error("the page is damaged or cut short; export it again");
  if (letters.length !== LETTERS * blocks) throw refuse();
  const bytes = new Uint8Array(4 * WORDS * blocks);
  const view = new DataView(bytes.buffer);
  let fault = 0;
  for (let block = 0, at = 0; block < blocks; block++) {
    // Words of the number, the least significant first. Two digits, then seven groups of three:
    // products stay below 2 to the 53rd, and a word is skipped until the number reaches it.
    let [a, b, c, d, e] = [DIGITS[letters[at++]], 0, 0, 0, 0];
    fault |= a;
    a *= BASE;
    for (let group = 0; group < 8; group++) {
      if (group > 0) {
        const first = DIGITS[letters[at++]];
        const second = DIGITS[letters[at++]];
        fault |= first | second;
        a = a * GROUP + first * BASE ** 2 + second * BASE;
      }
      const last = DIGITS[letters[at++]];
      fault |= last;
      a += last;
      if (group === 0) continue;
      let over = Math.floor(a * PART);
      a -= over * WORD;
      b = b * GROUP + over;
      if (group < 3) continue;
      over = Math.floor(b * PART);
      b -= over * WORD;
      c = c * GROUP + over;
      if (group < 4) continue;
      over = Math.floor(c * PART);
      c -= over * WORD;
      d = d * GROUP + over;
      if (group < 6) continue;
      over = Math.floor(d * PART);
      d -= over * WORD;
      e = e * GROUP + over;
    }
    if (e >= WORD) fault = 128;
    const start = 4 * WORDS * block;
    view.setUint32(start, a, true);
    view.setUint32(start + 4, b, true);
    view.setUint32(start + 8, c, true);
    view.setUint32(start + 12, d, true);
    view.setUint32(start + 16, e, true);
  }
  if (fault & 128) throw refuse();
  return bytes.subarray(0, count);
}
