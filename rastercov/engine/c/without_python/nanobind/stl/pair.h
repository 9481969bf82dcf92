// In place of the casters of nanobind where there is no Python.
#pragma once
