"""The data set: samples of clips -> Parquet shards with card, statistics and pictures, and back; exports to other formats."""
