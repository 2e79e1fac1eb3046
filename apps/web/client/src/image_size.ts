// How wide an image has to come for the place where it is shown. Pure.

const WIDTHS = [160, 240, 320, 480, 640, 800, 960, 1280, 1600, 1920];

// Images as they are.
export const WHOLE = 0;

// The width to ask for: at least `cssPixels` on a screen with so many pixels each, in few steps so that a window that
// is dragged asks seldom. A place of unknown size gets the whole image.
export function widthFor(cssPixels: number, pixelRatio: number): number {
  const wanted = cssPixels * (pixelRatio > 0 ? pixelRatio : 1);
  if (!(wanted > 0)) return WHOLE;
  return WIDTHS.find((width) => width >= wanted) ?? WHOLE;
}

// Of several places the one that wants most; without any, the least.
export function widest(widths: Iterable<number>): number {
  let most = WIDTHS[0] as number;
  for (const width of widths) {
    if (width === WHOLE) return WHOLE;
    most = Math.max(most, width);
  }
  return most;
}
