import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";

// Width and height of an element in pixels, as they change.
export function useSize(ref) {
  const [size, setSize] = useState({ width: 0, height: 0 });
  useLayoutEffect(() => {
    const read = () => setSize({ width: ref.current.clientWidth, height: ref.current.clientHeight });
    const observer = new ResizeObserver(read);
    observer.observe(ref.current);
    read();
    return () => observer.disconnect();
  }, []);
  return size;
}

// The answer to a question to the server: {value}, {error} or neither yet.
export function useAnswer(ask, ...keys) {
  const [answer, setAnswer] = useState({});
  useEffect(() => {
    let wanted = true;
    setAnswer({});
    Promise.resolve()
      .then(ask)
      .then((value) => wanted && setAnswer({ value }))
      .catch((error) => wanted && setAnswer({ error: error.message }));
    return () => (wanted = false);
  }, keys);
  return answer;
}

// Draw again when the colours of the system change.
export function useTheme() {
  const [theme, setCount] = useState(0);
  useEffect(() => {
    const media = matchMedia("(prefers-color-scheme: dark)");
    const changed = () => setCount((count) => count + 1);
    media.addEventListener("change", changed);
    return () => media.removeEventListener("change", changed);
  }, []);
  return theme;
}

// Of a long list or table: the rows in view, and how to scroll to one.
export function useWindow(box, count, row_px, extra = 8) {
  const [top, setTop] = useState(0);
  const size = useSize(box);
  const from = Math.max(0, Math.floor(top / row_px) - extra);
  const until = Math.min(count, Math.ceil((top + size.height) / row_px) + extra);
  const show = (row) => {
    const element = box.current;
    const middle = row * row_px - element.clientHeight / 2;
    if (row * row_px < element.scrollTop + row_px || row * row_px > element.scrollTop + element.clientHeight - 2 * row_px) {
      element.scrollTop = Math.max(0, middle);
    }
  };
  return { from, until, show, onScroll: (event) => setTop(event.currentTarget.scrollTop), width: size.width };
}

export function useLatest(value) {
  const ref = useRef(value);
  ref.current = value;
  return ref;
}
