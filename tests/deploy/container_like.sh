#!/bin/sh
# Run a command in a place like a container's, in a mount namespace of its own: container_like.sh ROOT PLAN COMMAND …
# ROOT is an empty folder that becomes its root; PLAN has a line for each thing in it, in their order:
#   ro|rw SOURCE TARGET    a folder or file of this machine
#   tmpfs OPTIONS TARGET   an empty one in memory
# After that the root is read-only, and the command runs as UID:GID without any right.
set -eu
root=$1 plan=$2
shift 2
mount -t tmpfs -o mode=0755,size=16m tmpfs "$root"
while read -r kind source target; do
    place=$root$target
    if [ "$kind" = tmpfs ]; then
        mkdir -p "$place"
        mount -t tmpfs -o "$source" tmpfs "$place"
        continue
    fi
    if [ -d "$source" ]; then
        mkdir -p "$place"
        mount --rbind "$source" "$place"
    else
        mkdir -p "$(dirname "$place")"
        : >"$place"
        mount --bind "$source" "$place"
    fi
    if [ "$kind" = ro ]; then mount -o remount,bind,ro "$place"; fi
done <"$plan"
mount -o remount,ro "$root"
cd "$root"
exec chroot "$root" /usr/bin/setpriv --reuid="$CONTAINER_USER" --regid="$CONTAINER_GROUP" --clear-groups \
    --no-new-privs --inh-caps=-all --bounding-set=-all -- \
    /usr/bin/env --chdir=/tmp --ignore-environment "$@"
