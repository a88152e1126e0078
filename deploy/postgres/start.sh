# Makes the cluster and its database at the first start; no network, known users by their number alone.
set -eu
bin=/usr/lib/postgresql/15/bin
data=/var/lib/postgresql/data
if [ ! -s "$data/PG_VERSION" ]; then
  "$bin/initdb" --pgdata="$data" --auth=peer --encoding=UTF8 --data-checksums
  printf 'CREATE DATABASE distalock;\n' | "$bin/postgres" --single -D "$data" postgres
fi
exec "$bin/postgres" -D "$data" -c listen_addresses= -c unix_socket_directories=/run/postgresql
