"""Places in polygons, against shapely on random star-shaped outlines."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from bench.polygons import are_inside, is_inside


@pytest.mark.parametrize("seed", range(12))
def test_places_are_inside_where_shapely_says(seed: int) -> None:
    """One by one and all at once, in either direction of the corners; ends of edges at equal height included."""
    random = np.random.default_rng(seed)
    turns = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 12)))
    reach = random.uniform(5.0, 80.0, len(turns))
    corners = np.round(np.stack((reach * np.cos(turns), reach * np.sin(turns)), axis=1), seed % 3) + 3.0
    places = random.uniform(-90.0, 90.0, (400, 2))
    # Beside corners, at exactly their height: a ray through a corner counts once.
    places = np.concatenate((places, corners + np.array((7.0, 0.0)), corners - np.array((7.0, 0.0))))
    polygon = shapely.Polygon(corners)
    away = shapely.distance(polygon.exterior, shapely.points(places)) > 1e-9
    expected = shapely.contains_xy(polygon, places[:, 0], places[:, 1])
    outline = [(float(x), float(y)) for x, y in corners]
    for each in (outline, outline[::-1]):
        one_by_one = [is_inside((x, y), each) for x, y in places.tolist()]
        assert (np.array(one_by_one) == expected)[away].all()
        assert (are_inside(places, np.array(each)) == one_by_one).all()
    assert expected.any()
