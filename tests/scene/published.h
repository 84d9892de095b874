// Windows published as the imaging plane does, with all that a publication owes.
#pragma once

#include <memory>
#include <string>

#include "service/imaging_plane/publisher.h"

namespace teletact::service {

inline Published publish_into(Scenes& scenes, const std::shared_ptr<Scene>& scene,
                              const WindowEstimate& window, const std::string& client = {}) {
  Workers workers;
  Publisher publisher(scenes, workers);
  JobTerms terms;
  terms.client = client;
  Published published =
      workers.run(terms, [&] { return publisher.publish(scene, window, client); }).future.get();
  terms.owed = true;  // after all that is owed by a deadline
  workers.run(terms, [] {}).future.get();
  return published;
}

}  // namespace teletact::service
