// A row of nodes of a block of solid tissue, as all who touch it share it.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <exception>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "service/contact/corrector.h"
#include "service/contact/solid_contact.h"
#include "service/contact/solid_touch_model.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

// Corrected for them, beside their answers.
class SolidNodes {
 public:
  SolidNodes(const SolidBlock&, const std::shared_ptr<Device>&, const MemoryAccount&);
  // Another modulus in the place of another's, solved with what that has. Ready while that is touched.
  SolidNodes(const SolidBlock&, const SolidNodes& before, const MemoryAccount&);
  // A row of nodes of the same tissue, solved with what that has.
  SolidNodes(const SolidNodes& same, std::size_t row, const MemoryAccount&);

  // Whether its shares are learned; has it done by `work`, and again a while after it failed, which the log
  // says.
  static bool learned(const std::shared_ptr<SolidNodes>&, const TouchWork& work, const std::string& client);
  // SolidContact's, by any thread. Throws DeviceError, MemoryRefused.
  void learn_shares();
  // Of the last time; null: nothing failed.
  std::exception_ptr not_learned();
  // Whether what it took the place of had learned: until it has, that one answers.
  bool follows_learned() const { return follows_learned_; }
  Vector3 in_block(const TouchPose&) const;
  void move_to_scene(std::vector<NodalPressure>&) const;
  // Throws std::out_of_range where the tip is beside the block.
  void require_covered(const Fingertip&, const TouchPose&) const;

  const Region region;
  const double origin_x_m, origin_z_m;
  const std::array<double, 2> spacing_m;  // along x and z
  const MemoryAccount account;
  const std::shared_ptr<Device> device;     // outlives its queue's arrays
  const std::shared_ptr<std::mutex> mutex;  // of all that share the solver
  const Charge charge;
  SolidContact<float> contact;              // corrected under the mutex
  std::atomic<std::size_t> iterations = 0;  // of corrections since the last answer

 private:
  template <class Make>
  SolidNodes(const SolidNodes& other, const MemoryAccount&, Charge, const Make& contact);
  bool covers(const Fingertip&, const Vector3& position_m) const;
  void correct(const Fingertip&, const TouchPose&);  // by the corrector's thread
  const double around_x_m_, around_z_m_;  // tissue on each side, up to where the other side's begins
  bool follows_learned_ = false;
  std::mutex learned_mutex_;  // of these
  bool asked_to_learn_ = false;
  std::exception_ptr not_learned_;
  std::chrono::steady_clock::time_point learns_again_{};

 public:
  Corrector corrector{
      [this](const Fingertip& tip, const TouchPose& pose) { correct(tip, pose); }};  // ends first
};

// What no correction makes better is settled too: the answer says what it is off by.
bool settled(const SolveReport&);

}  // namespace teletact::service
