// A scene whose truth is known here: what suites that need a running service touch when none is given.
#pragma once

#include <grpcpp/channel.h>

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/reference/contact.h"

namespace teletact::bench {

// 120 x 40 mm, square elements of 2 mm or another whole part of that, a stiffer block in the middle.
reference::TouchedTissue own_tissue(double element_m = 0.002);

// What answers were checked against before they were timed, and what they were off by.
struct Checked {
  std::string against;
  double largest_relative_error = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Checked, against, largest_relative_error)

void remove_scene(v1::Palpation::Stub& stub, const std::string& scene_id);

// These take the place of a scene of that name. They throw BenchError.
void create_scene(v1::Palpation::Stub& stub, const v1::CreateSceneRequest& request);
void create_own_scene(v1::Palpation::Stub& stub, const std::string& scene_id,
                      const reference::TouchedTissue& tissue);

// The largest of the relative errors that `error_at` finds of a force at these shares of the width; throws
// BenchError for one beyond the tolerance. `of`: what it is compared with.
double largest_error(const char* of, double tolerance, const std::vector<double>& shares,
                     const std::function<double(double share)>& error_at);
// Largest relative force error of the service over a few poses; throws BenchError when it is not worth
// timing.
double check_against_reference(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                               const reference::TouchedTissue& tissue, double indentation_m);

// Both.
Checked make_checked_scene(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                           const reference::TouchedTissue& tissue, double indentation_m);

}  // namespace teletact::bench
