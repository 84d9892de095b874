// What `teletact-client touch` says at its end.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "client/session/operator_session.h"

namespace teletact::client {

nlohmann::json to_json(const std::string& scene_id, const std::string& renderer, const TouchSummary&);
// For people, from that.
void print_summary(const nlohmann::json& touch);

}  // namespace teletact::client
