// A plane of nodes of a block of solid tissue, ready to be touched: answers at once, corrections beside.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "service/contact/corrector.h"
#include "service/contact/solid_contact.h"
#include "service/contact/solid_touch_model.h"

namespace teletact::service {

class SolidLayer final : public TouchedLayer {
 public:
  SolidLayer(const SolidBlock&, const std::shared_ptr<Device>&, const MemoryAccount&);
  // Another modulus in the place of another's, solved with what that has. Ready while that is touched.
  SolidLayer(const SolidBlock&, const SolidLayer& before, const MemoryAccount&);
  // A row of nodes of the same tissue, solved with what that has.
  SolidLayer(const SolidLayer& same, std::size_t row, const MemoryAccount&);

  double drift() const { return contact_.drift().shape; }
  SolvePath path() const override { return SolvePath::kGradients; }
  // Corrections are made beside; none is waited for by a finger that is followed.
  bool prepare(const Fingertip&, const TouchPose&, double around_m, Clock::time_point until) override;
  bool welcomes(const Fingertip&, const TouchPose&) override;
  ContactAnswer touch(const Fingertip&, const TouchPose&) override;
  std::optional<std::vector<NodalPressure>> layered_pressure(const Fingertip&, const TouchPose&,
                                                             double force_n) const override;
  std::optional<DeformedLayer> deformed(const Fingertip&, const TouchPose&, double around_m,
                                        std::size_t max_nodes) const override;
  std::string remark(const Fingertip&, const TouchPose&) const override;
  std::shared_ptr<TouchedLayer> apart() override;
  // SolidContact's, by any thread. Throws DeviceError, MemoryRefused.
  void learn_shares();
  // Whether that is done; has it done by `work`, and again a while after it failed, which the log says.
  static bool learned(const std::shared_ptr<SolidLayer>&, const TouchWork& work, const std::string& client);
  // Of the last time; null: nothing failed.
  std::exception_ptr not_learned();
  // Whether what it took the place of had learned: until it has, that one answers.
  bool follows_learned() const { return follows_learned_; }
  std::shared_ptr<const SharesTouch> shares(const Fingertip& tip) const { return contact_.shares(tip); }
  Vector3 in_block(const TouchPose&) const;
  // Throws std::out_of_range where the tip is beside the block.
  void require_covered(const Fingertip&, const TouchPose&) const;
  std::array<double, 2> spacing_m(double) const override { return spacing_m_; }

 private:
  friend class LayerApart;
  template <class Make>
  SolidLayer(const SolidLayer& other, const MemoryAccount&, Charge, const Make& contact);
  struct Last {
    Fingertip tip;
    Vector3 position_m;
    std::uint64_t done;  // corrections by then
    ContactAnswer answer;
  };
  struct Track {
    Vector3 position_m;
    Clock::time_point at;
  };
  void move_to_scene(std::vector<NodalPressure>&) const;
  // Whether a finger that may have come from there was answered well a short time ago.
  bool follows(const TouchPose&);
  void follow(const TouchPose&);
  std::deque<Track>::iterator own_track(const TouchPose&);
  bool covers(const Fingertip&, const Vector3& position_m) const;
  ContactAnswer answered(const Fingertip&, const TouchPose&);  // by what was learned up to now
  void correct(const Fingertip&, const TouchPose&);            // by the corrector's thread
  // Others would fail as well, and another device may not. Once: the next touch tries again.
  void rethrow_of_device(const std::exception_ptr&);

  const Region region_;
  const double origin_x_m_, origin_z_m_;
  const double around_x_m_, around_z_m_;   // tissue on each side, up to where the other side's begins
  const std::array<double, 2> spacing_m_;  // along x and z
  const MemoryAccount account_;
  const std::shared_ptr<Device> device_;     // outlives its queue's arrays
  const std::shared_ptr<std::mutex> mutex_;  // of all that share the solver
  const Charge charge_;
  SolidContact<float> contact_;  // corrected under the mutex
  std::mutex last_mutex_;        // of these
  std::optional<Last> last_;
  std::deque<Track> tracks_;                 // of fingers that are followed
  std::atomic<std::size_t> iterations_ = 0;  // of corrections since the last answer
  bool follows_learned_ = false;
  std::mutex learned_mutex_;  // of these
  bool asked_to_learn_ = false;
  std::exception_ptr not_learned_;
  Clock::time_point learns_again_{};
  Corrector corrector_{
      [this](const Fingertip& tip, const TouchPose& pose) { correct(tip, pose); }};  // ends first
};

}  // namespace teletact::service
