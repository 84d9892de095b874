"""A ROS 2 arm that speaks CRTK feels the tissue of a teletact service. Guide: docs/guide/ros.md."""
