// A scene whose truth is known here: what suites that need a running service touch when none is given.
#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>

#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/reference/contact.h"

namespace teletact::bench {

// 120 x 40 mm, 2 mm elements, a stiffer block in the middle.
reference::TouchedTissue own_tissue();

// Takes the place of a scene of that name. Throws BenchError.
void create_own_scene(v1::Palpation::Stub& stub, const std::string& scene_id,
                      const reference::TouchedTissue& tissue);

// Largest relative force error of the service over a few poses; throws BenchError when it is not worth
// timing.
double check_against_reference(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                               const reference::TouchedTissue& tissue, double indentation_m);

}  // namespace teletact::bench
