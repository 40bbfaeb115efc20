"""An excitation with the blocks that it is made for."""

from duralab_settings import BlockSettings, ResolvedExcitation


class ExperimentSettings(ResolvedExcitation, BlockSettings):
    """The excitation of one experiment, and the blocks that its record is cut into; see `ResolvedExcitation`."""

    def samples(self, sample_rate: float) -> int:
        """Count the samples of the duration.

        Parameters
        ----------
        sample_rate
            In hertz.

        Returns
        -------
        int
            The whole number nearest to duration times rate.
        """
        return round(self.duration * sample_rate)

    def fade_samples(self, sample_rate: float) -> int:
        """Count the samples of one fade.

        Parameters
        ----------
        sample_rate
            In hertz.

        Returns
        -------
        int
            The whole number nearest to fade times rate.
        """
        return round(self.fade * sample_rate)
