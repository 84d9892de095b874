"""Where an arm takes wrenches, in the order of preference.

Of ``body`` a wrench is along the tool's axes; of ``spatial`` along the base's, about the base's origin; plain ``servo_cf`` is
as its header says.
"""

TOPICS = ("body/servo_cf", "spatial/servo_cf", "servo_cf")
BODY, SPATIAL, PLAIN = range(3)
