// The stimuli of an experiment as tissues on a service: one scene for each stiffness.
//
// A tissue's stiffness is contact force over indentation, straight down at one place and a stated depth, as
// the service answers it. Linear tissue of one modulus has a force that is proportional to the modulus, at
// every depth: so the ratio of two stimuli is the ratio of two such tissues wherever they are pressed. A lump
// in a background is softer or harder than its modulus says, and its modulus is looked for. Either way each
// tissue is touched before anybody is asked, and kept only when its stiffness is the stimulus to
// kOffMax.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "client/experiment/spring_display.h"
#include "client/link/credentials.h"
#include "client/render/contact_frame.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {

struct TissueOptions {
  std::string address;
  Credentials credentials;
  bool solid = false;      // else a line: a plane scene
  double depth_m = 0.004;  // at which a tissue has the stimulus's stiffness, 0.001 to 0.008
  // Where the stimulus is: everywhere, or in an upright lump, of a solid a round one, that goes down to the
  // bottom.
  SpringPlace place;
};

// Throws std::invalid_argument naming the field: depth_m outside of its range, or as validate(SpringPlace).
void validate(const TissueOptions&);

// A trial's: "law through a service on a line 4 mm deep", and as that of springs on an inclusion.
std::string condition_of(const std::string& renderer, const TissueOptions&);

class StimulusScenes {
 public:
  static constexpr double kOffMax = 0.005;  // of a stimulus, what its tissue is felt as
  static constexpr double kLostS = 10;       // a service that is gone for longer is lost

  // Reaches the service. `say`: one line for a person, and no stiffness. `stop` outlives this: it ends every
  // wait. Throws as validate() and reach_service().
  StimulusScenes(const TissueOptions&, const std::atomic<bool>& stop,
                 std::function<void(const std::string&)> say);
  // Takes the scenes away; those that cannot be are said.
  ~StimulusScenes();
  StimulusScenes(const StimulusScenes&) = delete;
  StimulusScenes& operator=(const StimulusScenes&) = delete;

  // Once: a tissue for each. Throws std::invalid_argument naming the field where a lump cannot be felt as
  // that, std::runtime_error in one line where the service does not take them, DisplayLost where it is lost.
  // With `stop` set it returns before they are all there.
  void make(const std::vector<double>& stimuli_n_m, double background_n_m);
  // After something was lost: what the service no longer has is made again. Throws as make().
  void make_sure();

  // Of a stiffness that make() was given.
  const std::string& scene_of(double stiffness_n_m) const;
  // What a touch stream of such a scene is opened with.
  v1::TouchOpen open(const std::string& scene_id) const;
  // On the surface: where a finger begins, and the middle of the stimulus.
  Vector3 start_m() const;
  Vector3 middle_m() const;
  const TissueOptions& options() const { return options_; }

 private:
  struct Made {
    double stiffness_n_m = 0;  // that was asked for
    double modulus_pa = 0, background_pa = 0;
    std::string scene_id;
  };
  Made make_one(double stiffness_n_m, double guess_pa);
  v1::CreateSceneRequest request_of(const Made&) const;
  void create(const Made&);
  bool exists(const std::string& scene_id);
  bool remove(const std::string& scene_id);
  double touch(const std::string& scene_id);
  // A call that is under way, and what to tell of its end.
  using Done = std::function<void(grpc::Status)>;
  using Call = std::function<void(grpc::ClientContext&, Done)>;
  grpc::Status retried(const std::string& scene_id, int seconds, const Call& call);

  TissueOptions options_;
  const std::atomic<bool>& stop_;
  std::function<void(const std::string&)> say_;
  std::unique_ptr<v1::Palpation::Stub> stub_;
  std::string name_;  // that all of their names begin with
  unsigned created_ = 0;
  double background_pa_ = 0;        // 0: not known yet
  std::vector<Made> made_;          // the tissues of the stimuli
  std::vector<std::string> there_;  // scenes that may be on the service
};

}  // namespace teletact::client
