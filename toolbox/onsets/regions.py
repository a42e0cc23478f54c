"""The regions of a severity map, and what each means for who drives the machine."""

MEANINGS = {
    "free": "smooth: a disturbance dies, and stick-slip that has begun ends",
    "bistable": "smooth until disturbed, then stick-slip for ever",
    "smooth or stuck": "smooth until it is stopped, then at rest for good",
    "stuck": "the least disturbance brings it to rest for good",
    "stick-slip": "the least disturbance grows into it",
    "swing": "the least disturbance grows, without stick",
    "none": "no steady running, or a run that failed",
}
"""{name of a region: what the machine does in it}."""
