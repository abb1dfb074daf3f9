# Sourced by ./run: .venv-peers, annik without torch beside the solvers that it is compared with.
# Uses what ./run defines: root, ros_python, log, say, die, failed, supported_python.

peers="$root/.venv-peers"

setup_peers() { # .venv-peers: annik without torch, and the solvers that it is compared with
  local python="${ros_python:-$(supported_python)}" made
  made="$("$python" -V) $root"
  made+=" $(cat "$root"/{setup.py,package.xml,constraints-peers.txt} | sha256sum)"
  mkdir -p "$root/build"
  exec {lock}>"$root/build/setup-peers.lock"
  flock "$lock"
  if [[ $(cat "$peers/annik-setup" 2>/dev/null) != "$made" ]]; then
    if [[ -e $peers && ! -f $peers/annik-setup ]]; then
      die "$peers is there but ./run did not make it; move it away and run this again"
    fi
    log="$root/build/setup-peers.log"
    : >"$log"
    say "making .venv-peers with the solvers of others: some minutes (details: ${log#"$root"/})"
    rm -rf "$peers"
    mkdir "$peers"
    touch "$peers/annik-setup" "$peers/COLCON_IGNORE"
    "$python" -m venv "$peers" >>"$log" 2>&1 || failed "making .venv-peers"
    install_peers
    link_pykdl
    echo "$made" >"$peers/annik-setup"
  fi
  exec {lock}>&-
}

install_peers() { # all at once; if one of them can't be installed, each by itself
  local pip=("$peers/bin/python" -m pip install -c "$root/constraints-peers.txt") one
  "${pip[@]}" -e "$root[peers,oracles]" >>"$log" 2>&1 && return
  "${pip[@]}" -e "$root[oracles]" >>"$log" 2>&1 || failed "pip install"
  while read -r one; do
    "${pip[@]}" "$one" >>"$log" 2>&1 </dev/null ||
      say "can't install $one: the benchmark goes without it"
  done < <("$peers/bin/python" - <<'END'
from importlib.metadata import requires

for requirement in requires("annik_ros"):
    wanted, _, condition = requirement.partition(";")
    if "peers" in condition:
        print(wanted.strip())
END
  )
}

link_pykdl() { # Debian's python3-pykdl, where it is for this interpreter; it is built for numpy 1
  local python="$peers/bin/python" library
  library="PyKDL$("$python" -c 'import sysconfig; print(sysconfig.get_config_var("EXT_SUFFIX"))')"
  [[ -e /usr/lib/python3/dist-packages/$library ]] || return 0
  if "$python" -m pip install numpy==1.26.4 >>"$log" 2>&1; then
    ln -s "/usr/lib/python3/dist-packages/$library" \
      "$("$python" -c 'import sysconfig; print(sysconfig.get_path("platlib"))')"
  else say "can't install numpy 1.26.4: the benchmark goes without KDL"; fi
}

use_peers() { # small matrices: sharing them among threads takes longer than computing them
  export VIRTUAL_ENV="$peers" PATH="$peers/bin:$PATH" OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
}
