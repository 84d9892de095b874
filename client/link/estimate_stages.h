// The stages of an estimate, in words.
#pragma once

#include "teletact/v1/elastography.pb.h"

namespace teletact::client {

inline const char* stage_name(v1::EstimateStage stage) {
  switch (stage) {
    case v1::ESTIMATE_STAGE_RECEIVED:
      return "received";
    case v1::ESTIMATE_STAGE_DISPLACEMENT:
      return "displacement";
    case v1::ESTIMATE_STAGE_STRAIN:
      return "strain";
    case v1::ESTIMATE_STAGE_MODULUS:
      return "modulus";
    case v1::ESTIMATE_STAGE_PUBLISHED:
      return "published";
    default:
      return "working";
  }
}

}  // namespace teletact::client
