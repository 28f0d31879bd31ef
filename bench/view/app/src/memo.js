// A component that is drawn again only when a property has changed.
import { Component, createElement } from "preact";

export function memo(draw) {
  return class extends Component {
    shouldComponentUpdate(next) {
      const names = new Set([...Object.keys(next), ...Object.keys(this.props)]);
      return [...names].some((name) => next[name] !== this.props[name]);
    }
    render(properties) {
      return createElement(draw, properties);
    }
  };
}
