// proto -> domain for moduli that are given. What comes in is checked before anything is allocated for it;
// std::invalid_argument names the field as the contract does and says what to do.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "service/scene/slices.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

std::size_t bytes_per_item(v1::DataType);
// None: the scene begins empty. Beyond the limits' elements Error(kExhausted), before the values are read.
std::optional<ExplicitModulus> modulus_from(const v1::CreateSceneRequest&, const Limits&);
// `field`: where it stands in its message; of which solid it is.
ModulusSlice slice_from(const std::string& field, const v1::ModulusSlice&, const ExplicitModulus& solid);

}  // namespace teletact::service
