#!/bin/sh
# Build and test the studio's page, and check that the committed files in src/ are what was built.
# Without npm it says that it checked nothing.
set -eu
cd "$(dirname "$0")/../page"

if ! command -v npm >/dev/null; then
    echo "page: SKIPPED: there is no npm, so the page was neither built nor tested, nor compared with the committed one"
    exit 0
fi
built=$(mktemp -d)
trap 'rm -rf "$built"' EXIT
npm ci --no-audit --no-fund --loglevel error
npm test
npm run check
npx vite build --logLevel warn --outDir "$built" --emptyOutDir
if ! diff -r "$built" ../src/photonbeams/studio/page >/dev/null; then
    echo "page: src/photonbeams/studio/page is not what page/src builds: run 'npm run build' in page/, and commit" >&2
    diff -rq "$built" ../src/photonbeams/studio/page >&2 || true
    exit 1
fi
echo "page: built, tested, and the same as the committed one"
