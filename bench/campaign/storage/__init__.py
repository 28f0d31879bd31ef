"""What a campaign leaves on disk: its folder, files written whole, results, the manifest and the journal."""
