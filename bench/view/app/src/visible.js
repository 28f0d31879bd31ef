// Texts of agents, vehicles and files from elsewhere, with an escape in place of each character that is not seen.
// The same as bench/visible_text.py: controls, bidirectional and zero-width marks, halves of characters, tags.
const HIDDEN =
  /[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff\u{13430}-\u{1343f}\u{1bca0}-\u{1bca3}\u{1d173}-\u{1d17a}\u{e0000}-\u{e00ff}]/gu;

const escaped = (sign) =>
  sign < " "
    ? `\\x${sign.charCodeAt(0).toString(16).padStart(2, "0")}`
    : [...Array(sign.length).keys()].map((at) => `\\u${sign.charCodeAt(at).toString(16).padStart(4, "0")}`).join("");

export const visible = (text) => String(text ?? "").replace(HIDDEN, escaped);

// Of one line: newlines and tabs are shown too.
export const oneLine = (text) => visible(text).replace(/\s+/g, " ");
