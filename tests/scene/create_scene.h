// A scene made, and waited for.
#pragma once

#include <future>
#include <utility>

#include "service/scene/scenes.h"

namespace teletact::service {

inline std::shared_ptr<Scene> create_scene(Scenes& scenes, const std::string& id,
                                           const SceneGeometry& geometry,
                                           std::optional<ExplicitModulus> modulus,
                                           const std::string& client = {}) {
  std::promise<std::shared_ptr<Scene>> made;
  scenes.make(
      id, geometry, std::move(modulus),
      [&](const std::shared_ptr<Scene>& scene, std::exception_ptr error) {
        error ? made.set_exception(error) : made.set_value(scene);
      },
      client);
  return made.get_future().get();
}

}  // namespace teletact::service
