"""Quality of service of a subscription: from the command line, or compatible with all publishers."""

from rclpy.duration import Duration
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSLivelinessPolicy,
    QoSPresetProfiles,
    QoSReliabilityPolicy,
)

from pkm_nodes.ros2.shared import number

POLICIES = {
    'history': QoSHistoryPolicy,
    'reliability': QoSReliabilityPolicy,
    'durability': QoSDurabilityPolicy,
    'liveliness': QoSLivelinessPolicy,
}
STRONG_AND_WEAK = {  # a subscription with the weak policy connects to every publisher
    'reliability': (QoSReliabilityPolicy.RELIABLE, QoSReliabilityPolicy.BEST_EFFORT),
    'durability': (QoSDurabilityPolicy.TRANSIENT_LOCAL, QoSDurabilityPolicy.VOLATILE),
}


def add_qos_arguments(parser, do='subscribe', default_profile='sensor_data', fits='what fits the running publishers'):
    """Add the --qos-* arguments of an endpoint that is to `do` something; `fits` is chosen by default, see `help`."""
    parser.add_argument(
        '--qos-profile',
        choices=QoSPresetProfiles.short_keys(),
        default=default_profile,
        help=f'Quality of service preset profile to {do} with (default: {default_profile})',
    )
    parser.add_argument(
        '--qos-depth',
        metavar='N',
        type=number(int, lambda n: n > 0, 'a positive integer'),
        help='Queue size (overrides depth value of --qos-profile option)',
    )
    for name, policy in POLICIES.items():
        default = f', default: {fits}' if fits and name in STRONG_AND_WEAK else ''
        parser.add_argument(
            f'--qos-{name}',
            choices=policy.short_keys(),
            help=f'Quality of service {name} setting (overrides {name} value of --qos-profile option{default})',
        )
    parser.add_argument(
        '--qos-liveliness-lease-duration-seconds',
        type=number(float, lambda seconds: seconds > 0, 'positive'),
        help=f'Quality of service liveliness lease duration setting to {do} with',
    )


def choose_qos(node, topic_name, args):
    """Return the profile of the --qos-* arguments; with at most --qos-profile, one that fits all publishers."""
    profile, asked = profile_of(args)
    if not asked:
        return match_publishers(profile, node.get_publishers_info_by_topic(topic_name))
    return profile


def profile_of(args):
    """Return the profile of the --qos-* arguments, and whether they set more than --qos-profile."""
    profile = QoSPresetProfiles.get_from_short_key(args.qos_profile)
    asked = {name: getattr(args, f'qos_{name}') for name in POLICIES if getattr(args, f'qos_{name}') is not None}
    lease, depth = args.qos_liveliness_lease_duration_seconds, args.qos_depth
    for name, key in asked.items():
        setattr(profile, name, POLICIES[name].get_from_short_key(key))
    if lease is not None:
        profile.liveliness_lease_duration = Duration(seconds=lease)
    if depth is not None:
        profile.depth = depth
    return profile, bool(asked) or lease is not None or depth is not None


def match_publishers(profile, publishers):
    """Set the strong policy where all publishers offer it; it is incompatible with a publisher that does not."""
    for name, (strong, weak) in STRONG_AND_WEAK.items() if publishers else ():
        offered = [getattr(publisher.qos_profile, name) == strong for publisher in publishers]
        setattr(profile, name, strong if all(offered) else weak)
        if any(offered) and not all(offered):
            policy = f'QoS{name.capitalize()}Policy'
            print(
                f'Some, but not all, publishers are offering {policy}.{strong.name}. '
                f'Falling back to {policy}.{weak.name} as it will connect to all publishers'
            )
    return profile
