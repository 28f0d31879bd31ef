"""Safety: failsafes, fence, checks before arming, and injected failures."""
