#!/bin/sh
# A Dask worker that is started again whenever it ends, for instance with its scheduler:
# cluster/worker.sh tls://HOST:8786 [options of `dask worker`]. SIGTERM ends both.
files=$(mktemp -d)
# A worker that is starting when its scheduler goes may wait for it without end: killed after 30 seconds.
stop() {
  kill $! 2>/dev/null
  for _ in $(seq 60); do kill -0 $! 2>/dev/null || break; sleep 0.5; done
  kill -9 $! 2>/dev/null
  wait
  rm -rf "$files"
  exit 0
}
trap stop TERM INT HUP
while :; do
  python -m dask worker --nworkers 1 --memory-limit 0 --no-dashboard --local-directory "$files" "$@" &
  wait $!
  rm -rf "$files"/*
  sleep 2 &
  wait $!
done
