#!/bin/sh
# A Dask worker that is started again whenever it ends, for instance with its scheduler:
# cluster/worker.sh tls://HOST:8786 [options of `dask worker`]. SIGTERM ends both.
files=$(mktemp -d)
trap 'kill $! 2>/dev/null; wait; rm -rf "$files"; exit 0' TERM INT HUP
while :; do
  python -m dask worker --nworkers 1 --memory-limit 0 --no-dashboard --local-directory "$files" "$@" &
  wait $!
  rm -rf "$files"/*
  sleep 2 &
  wait $!
done
