"""Print compose.yaml, one service per node: `.venv/bin/python docker/compose.py > docker/compose.yaml`."""

from pkm_nodes.graph import cell_nodes

HEAD = """# Written by docker/compose.py from the list of nodes. The cell on one host, one service per node:
#   docker compose -f docker/compose.yaml up --build -d
# docs/docker.md describes how to send a motion and how to set up keys.
x-node: &node
  image: pkm-cell
  user: ${PKM_USER:-10001:10001} # owner of the folder runs; never root
  cap_drop: [ALL]
  security_opt: ['no-new-privileges:true']
  restart: 'no' # no automatic restart: the machine has stopped safely, and the cause needs inspection
  ipc: service:machine # DDS uses shared memory between processes of one host
  depends_on: [machine]
  stop_signal: SIGINT # the recorder closes its bag first
  stop_grace_period: 15s
  environment: &environment
    ROS_DOMAIN_ID: ${ROS_DOMAIN_ID:-0}
    ROS_SECURITY_ENABLE: ${PKM_SECURITY:-false}
    ROS_SECURITY_STRATEGY: Enforce
    ROS_SECURITY_KEYSTORE: /keystore
    ROS_SECURITY_ENCLAVE_OVERRIDE: /pkm
  volumes: &volumes
    - ../runs:/runs
    # the part of the keystore a node needs, without the private keys of the authorities
    - ${PKM_KEYSTORE:-../keystore}/enclaves:/keystore/enclaves:ro
    - ${PKM_KEYSTORE:-../keystore}/public:/keystore/public:ro

services:
"""
MACHINE = """    image: pkm-cell
    build: {context: .., dockerfile: docker/Dockerfile}
    user: ${PKM_USER:-10001:10001}
    cap_drop: [ALL]
    security_opt: ['no-new-privileges:true']
    restart: 'no'
    ipc: shareable
    stop_signal: SIGINT
    environment: *environment
    volumes: *volumes
"""


def main():
    """Print the file."""
    print(HEAD, end='')
    for spec in cell_nodes('four_dof', folder='/runs/bags'):
        command = ['ros2', 'run', 'pkm_nodes', spec.executable, *spec.arguments({'use_sim_time': True})]
        service = MACHINE if spec.name == 'machine' else '    <<: *node\n'
        print(f'  {spec.name}:\n{service}    command: {command}')


if __name__ == '__main__':
    main()
