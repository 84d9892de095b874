// The finger of a recorded touch, over and over.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "teletact/v1/palpation.pb.h"

namespace teletact::bench {

struct RecordedTouch {
  struct Pose {
    double time_s = 0;  // since the first
    std::array<double, 3> position_m{}, velocity_m_s{};
  };
  std::string scene_id;
  v1::TouchOpen open;       // as it was asked for
  std::vector<Pose> poses;  // of all its streams
  double length_s = 0;      // and a usual interval after the last: then it begins again
};

// Of `touch --record`. Throws std::runtime_error, one line: unreadable, of another kind, or with less than
// two poses.
std::shared_ptr<const RecordedTouch> read_recorded_touch(const std::string& path);

class RecordedFinger {
 public:
  // Of one client out of several: each begins elsewhere in it.
  RecordedFinger(std::shared_ptr<const RecordedTouch>, unsigned client);
  // The instant of the next pose, s since the begin, increasing without an end.
  double next();
  // The pose whose instant is nearest.
  const RecordedTouch::Pose& at(double time_s) const;

 private:
  std::shared_ptr<const RecordedTouch> touch_;
  double ahead_s_;        // of the recording, at the begin
  std::size_t next_ = 0;  // pose, counted through all rounds
};

}  // namespace teletact::bench
