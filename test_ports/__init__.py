"""Test ports: the measures that turn the streams of a recording into observables."""
