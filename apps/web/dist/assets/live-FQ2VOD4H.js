import{a,b,c}from"./chunk-LSA77XK4.js";import"./chunk-VRC6BHOB.js";import"./chunk-TSQNNR2A.js";export{c as Live,b as LiveFigures,a as WALL};
