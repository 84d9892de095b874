#include "service/rpc/named_scene.h"

#include <fmt/format.h>

#include <stdexcept>
#include <string_view>

#include "service/scene/errors.h"

namespace teletact::service {

void require_named(const grpc::ServerContextBase& context, const std::string& scene_id) {
  const auto [first, last] = context.client_metadata().equal_range("teletact-scene");
  for (auto named = first; named != last; ++named) {
    const std::string_view name(named->second.data(), named->second.size());
    if (name != scene_id)
      throw std::invalid_argument(
          fmt::format("scene_id: the message says \"{}\", the metadata teletact-scene \"{}\"; a proxy may "
                      "have brought the "
                      "call to another node than the scene's: give the same in both, or no metadata",
                      shown(scene_id), shown(name)));
  }
}

}  // namespace teletact::service
