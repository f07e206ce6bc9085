// Reads an SDF world with Debian's libsdformat, strictly, and prints what it understood:
// one line "MODEL X Y HEIGHT X1 Y1 X2 Y2 ..." per static model with an extruded outline.
//   read_sdf WORLD MODEL_FOLDER
#include <iostream>
#include <string>

#include <sdf/sdf.hh>

int main(int argc, char **argv)
{
  if (argc != 3)
    return 2;
  const std::string models = argv[2];
  sdf::ParserConfig config;
  config.SetWarningsPolicy(sdf::EnforcementPolicy::ERR);
  config.SetUnrecognizedElementsPolicy(sdf::EnforcementPolicy::ERR);
  config.SetFindCallback([&models](const std::string &uri) {
    return models + "/" + uri.substr(uri.find("://") + 3);
  });
  sdf::Root root;
  bool refused = false;
  for (const auto &error : root.Load(argv[1], config))
  {
    std::cerr << error << "\n";
    refused = true;
  }
  if (refused || root.WorldCount() != 1)
    return 1;
  const sdf::World *world = root.WorldByIndex(0);
  std::cout.precision(17);
  for (uint64_t i = 0; i < world->ModelCount(); ++i)
  {
    const sdf::Model *model = world->ModelByIndex(i);
    const sdf::Link *link = model->LinkByIndex(0);
    if (!model->Static() || link == nullptr || link->CollisionCount() != 1)
      continue;
    auto geometry = link->CollisionByIndex(0)->Element()->GetElement("geometry");
    if (!geometry->HasElement("polyline"))
      continue;
    auto outline = geometry->GetElement("polyline");
    std::cout << model->Name() << " " << model->RawPose().Pos().X() << " "
              << model->RawPose().Pos().Y() << " " << outline->Get<double>("height");
    for (auto point = outline->GetElement("point"); point; point = point->GetNextElement("point"))
    {
      const auto at = point->Get<ignition::math::Vector2d>();
      std::cout << " " << at.X() << " " << at.Y();
    }
    std::cout << "\n";
  }
  return 0;
}
