"""The names of pose sources, said once."""

from ogm_mcmc.config.pose_sources import OFFLINE_POSE_SOURCES, POSE_SOURCES, POSE_SOURCES_TEXT
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.tf_messages import TF_TYPES


def test_offline_offers_what_the_nodes_take_and_to_choose_itself():
    assert OFFLINE_POSE_SOURCES == (
        'auto',
        'pose',
        'pose_stamped',
        'odom',
        'particles',
        'particle_cloud',
        'tf',
    )
    assert [entry.split(':')[0] for entry in POSE_SOURCES_TEXT.split('; ')] == list(POSE_SOURCES)


def test_each_is_of_the_type_of_message_that_readers_know():
    assert POSE_SOURCES == {
        'pose': (ros_types.POSE,),
        'pose_stamped': (ros_types.POSE_STAMPED,),
        'odom': (ros_types.ODOMETRY,),
        'particles': (ros_types.PARTICLES,),
        'particle_cloud': (ros_types.PARTICLE_CLOUD,),
        'tf': TF_TYPES,
    }
