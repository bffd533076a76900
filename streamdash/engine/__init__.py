"""The forward model: galpy's stream, its geometry, impacts, kicks and the march. Arrays in, arrays out."""
