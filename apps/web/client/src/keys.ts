// Keys and mouse of the browser as the program's sessions know them (session.h, Event).

const NAMED: Record<string, number> = {
  Escape: 27,
  Enter: 13,
  ' ': 32,
  Backspace: 8,
  Tab: 9,
  ArrowLeft: 0x10001,
  ArrowRight: 0x10002,
  ArrowUp: 0x10003,
  ArrowDown: 0x10004,
  Delete: 0x10005,
};

const REPEATING = new Set([8, 0x10001, 0x10002, 0x10003, 0x10004, 0x10005, 43, 45]);

export interface KeyPress {
  key: string;
  shiftKey: boolean;
  ctrlKey: boolean;
  altKey: boolean;
  metaKey: boolean;
  repeat: boolean;
}

// The code of a key, or null where the key is not the session's: with Alt or Meta, Tab (it moves the
// focus), keys that repeat and should not, function keys.
export function sessionKey(press: KeyPress): number | null {
  if (press.altKey || press.metaKey || press.key === 'Tab') return null;
  let code = NAMED[press.key];
  if (code === undefined && press.key.length === 1) {
    const point = press.key.charCodeAt(0);
    if (point >= 32 && point < 127) code = point;
  }
  if (code === undefined) return null;
  // The browser keeps copy, paste, reload, new tab and so on. Only undo and redo are passed with Ctrl.
  if (press.ctrlKey && !'zyZY'.includes(press.key)) return null;
  if (press.repeat && !REPEATING.has(code)) return null;
  return code;
}

// The name of a key for people: 115 is "s", 0x10001 is "←".
export function keyName(code: number): string {
  switch (code) {
    case 0:
      return '';
    case 27:
      return 'Esc';
    case 13:
      return 'Enter';
    case 32:
      return 'Space';
    case 8:
      return 'Backspace';
    case 9:
      return 'Tab';
    case 0x10001:
      return '←';
    case 0x10002:
      return '→';
    case 0x10003:
      return '↑';
    case 0x10004:
      return '↓';
    case 0x10005:
      return 'Delete';
    default:
      return code > 32 && code < 127 ? String.fromCharCode(code) : '';
  }
}

// The pixel of the image under a point of the page; pixel centres are integers. The image lies in the
// middle of its box, as large as it fits (object-fit: contain).
export function imagePoint(
  at: { clientX: number; clientY: number },
  box: { left: number; top: number; width: number; height: number },
  image: { width: number; height: number },
): { x: number; y: number } {
  const scale = Math.min(box.width / image.width, box.height / image.height) || 1;
  const left = box.left + (box.width - image.width * scale) / 2;
  const top = box.top + (box.height - image.height * scale) / 2;
  const round = (value: number) => Math.round(value * 10) / 10;
  return { x: round((at.clientX - left) / scale - 0.5), y: round((at.clientY - top) / scale - 0.5) };
}
