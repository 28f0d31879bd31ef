"""From recordings to results and scores: measures, scoring a recording again, the finished campaign."""
